"""`plcemu verify --spin` and `--promela` as users type them, in this process."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from systems import BATCH, ROOT
from tools import need_spin, need_tool

Run = Callable[..., Any]
TANK = ROOT / "il_programs/heating_tank"


def test_spin_stands_beside_our_verdicts_and_agreement_ends_with_0(plcemu: Run) -> None:
    need_spin()
    outcome = plcemu("verify", BATCH, "--property", "produces", "--spin", "--json")
    assert outcome.code == 0
    told = outcome.document["spin"]
    assert told["agrees"] is True and told["searches"] >= 1 and told["states"] > 100
    assert [(row["name"], row["asked"], row["verdict"]) for row in told["verdicts"]] == [
        ("no_fault", True, "holds"), ("produces", True, "holds")]


def test_what_spin_is_not_asked_is_said_and_its_trails_are_executed(plcemu: Run) -> None:
    need_spin()
    outcome = plcemu("verify", TANK, "--set", "program=version3.sipn", "--spin")
    assert outcome.code == 1
    assert "no verdict of SPIN on stable_again, reversible" in outcome.out
    assert "2 of SPIN's trails executed again" in outcome.out
    assert "DIFFERS" not in outcome.out


def test_without_spin_the_command_says_what_to_install(plcemu: Run,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    outcome = plcemu("verify", BATCH, "--property", "produces", "--spin")
    assert outcome.code != 0 and "apt install spin" in outcome.err


def test_the_model_is_written_with_its_tables_and_runs_as_its_head_says(plcemu: Run,
                                                                       tmp_path: Path) -> None:
    spin, compiler = need_tool("spin"), need_tool("gcc")
    outcome = plcemu("verify", BATCH, "--promela", tmp_path / "batch.pml")
    assert outcome.code == 0 and "not asked of SPIN: batch_leaves" in outcome.out
    text = (tmp_path / "batch.pml").read_text(encoding="utf-8")
    assert "gcc -O2 -fwrapv -DNOREDUCE -DSAFETY -DNOCLAIM -o pan pan.c && ./pan -E" in text
    assert "BATCH_PLANT_Theta1 = BATCH_PLANT_Psi1 && !BATCH_PLANT_Theta5;" in text
    for command in ([spin, "-a", "batch.pml"],
                    [compiler, "-O2", "-w", "-fwrapv", "-DNOREDUCE", "-DSAFETY", "-DNOCLAIM", "-o",
                     "pan", "pan.c"]):
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    told = subprocess.run([tmp_path / "pan", "-E"], cwd=tmp_path, check=True, capture_output=True,
                          text=True).stdout
    assert "errors: 0" in told


def test_a_model_of_an_exploration_that_is_not_whole_is_refused(plcemu: Run,
                                                                tmp_path: Path) -> None:
    outcome = plcemu("verify", BATCH, "--set", "verify.limits.states=20", "--promela",
                     tmp_path / "batch.pml")
    assert outcome.code != 0 and "the limit of 20 states" in outcome.err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_named(plcemu: Run, tmp_path: Path) -> None:
    outcome = plcemu("verify", BATCH, "--promela", tmp_path / "none" / "batch.pml")
    assert outcome.code != 0 and "No such file or directory" in outcome.err
