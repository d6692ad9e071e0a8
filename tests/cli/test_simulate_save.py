"""`plcemu simulate --save`: what led to a violation plays again, without the plant."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from plcemu.cli.main import main

BATCH = "il_programs/batch_plant"


def verdicts(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, tuple[str, float]]:
    main(["simulate", "--json", *arguments])
    return {p["name"]: (p["verdict"], p["decided_at_s"])
            for p in json.loads(capsys.readouterr().out)["properties"]}


@pytest.mark.parametrize(("system", "cause", "until", "name"), [
    (BATCH, ("--fault", "V8 stuck at 100s"), "800s", "B1_steady"),
    (BATCH, ("--set", "load=7.5"), "4100s", "new_batch"),
    ("il_programs/heating_tank", ("--set", "program=version3.sipn", "--set", "stop_at_s=15"),
     "60s", "no_conflict"),
])
def test_a_violation_plays_again_at_the_same_instant(
        capsys: pytest.CaptureFixture[str], tmp_path: Path, system: str, cause: tuple[str, ...],
        until: str, name: str) -> None:
    found = verdicts(capsys, system, *cause, "--until", until, "--save", str(tmp_path))
    assert found[name][0] == "violated"
    settings = [text for text in cause if "=" in text]
    again = verdicts(capsys, system, *(part for text in settings for part in ("--set", text)),
                     "--no-plant", "--scenario", str(tmp_path / f"{name}.yaml"), "--until", until)
    assert again[name] == found[name]


def test_without_a_violation_nothing_is_written(
        capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["simulate", BATCH, "--until", "60s", "--save", str(tmp_path)]) == 0
    assert not list(tmp_path.iterdir())
    assert "written" not in capsys.readouterr().out


def test_forces_of_a_scenario_are_told(
        capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    scenario = tmp_path / "forced.yaml"
    scenario.write_text("- {at: 10s, force: {B3_level: 0}}\n", encoding="utf-8")
    main(["simulate", BATCH, "--until", "4500s", "--scenario", str(scenario), "--save",
          str(tmp_path)])
    assert "nothing is written: the scenario forces tags" in capsys.readouterr().out


def test_a_folder_that_is_not_there_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", BATCH, "--until", "1s", "--save", "nowhere"]) == 2
    assert "there is no such folder" in capsys.readouterr().err
