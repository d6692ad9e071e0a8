"""`plcemu verify` and `plcemu schedule` as users type them, in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from systems import BATCH

Run = Callable[..., Any]


@pytest.fixture
def mutant(tmp_path: Path) -> Path:
    """The batch plant's program without one of its priorities: P1 and P2 start together."""
    text = (BATCH / "batch_plant.sfc").read_text(encoding="utf-8")
    path = tmp_path / "mutant.sfc"
    path.write_text(text.replace("  LD   Psi2\n  ANDN Theta1\n", "  LD   Psi2\n"), "utf-8")
    return path


def test_verify_tells_every_property_and_ends_with_0(plcemu: Run) -> None:
    outcome = plcemu("verify", BATCH, "--json")
    rows = {p["name"]: p for p in outcome.document["properties"]}
    assert outcome.code == 0
    assert rows["produces"]["verdict"] == "holds" and rows["produces"]["states"] > 100
    assert rows["new_batch"]["verdict"] == "inconclusive"
    assert {"name", "formula", "verdict", "vacuous", "states", "seconds",
            "counterexample"} <= rows["produces"].keys()


def test_a_property_asked_for_by_name_that_cannot_be_decided_ends_with_1(plcemu: Run) -> None:
    outcome = plcemu("verify", BATCH, "--property", "new_batch")
    assert outcome.code == 1 and "durations" in outcome.out


def test_an_unknown_property_is_wrong_use_and_the_nearest_is_offered(plcemu: Run) -> None:
    outcome = plcemu("verify", BATCH, "--property", "produce")
    assert outcome.code == 2 and "'produces'" in outcome.err


def test_a_wrong_initial_is_wrong_use_with_its_place(plcemu: Run) -> None:
    outcome = plcemu("verify", BATCH, "--set", "initial=most")
    assert outcome.code == 2 and "load, loads, all" in outcome.err


def test_a_violation_is_shown_as_a_table_of_scans(plcemu: Run) -> None:
    outcome = plcemu("verify", BATCH, "--set", "load=0.5", "--property", "produces")
    assert outcome.code == 1
    assert "P1 ends" in outcome.out and "nothing can happen any more" in outcome.out


def test_a_limit_is_inconclusive(plcemu: Run) -> None:
    outcome = plcemu("verify", BATCH, "--set", "verify.limits.states=20", "--json")
    assert outcome.code == 1
    assert outcome.document["complete"] is False
    assert {p["verdict"] for p in outcome.document["properties"]} == {"inconclusive"}


def test_a_saved_counterexample_is_violated_in_simulate_at_the_same_instant(
        plcemu: Run, mutant: Path, tmp_path: Path) -> None:
    proof = plcemu("verify", BATCH, "--set", f"program={mutant}", "--property", "no_P1_with_P2",
                   "--save", tmp_path, "--json").document["properties"][0]
    played = plcemu("simulate", BATCH, "--set", f"program={mutant}", "--no-plant", "--scenario",
                    tmp_path / "no_P1_with_P2.yaml", "--until", "1s", "--json")
    judged = {p["name"]: p for p in played.document["properties"]}["no_P1_with_P2"]
    assert judged["verdict"] == "violated"
    assert judged["decided_at_s"] == proof["counterexample"]["ends_at_s"]


def test_schedule_tells_the_proved_period_and_the_starts(plcemu: Run) -> None:
    document = plcemu("schedule", BATCH, "--load", "7", "--batches", "3", "--json").document
    assert document["load"] == 7 and document["possible"] is True
    assert document["period_s"] == 3140 and document["proved_optimal"] is True
    assert document["certificate_checked"] is True and document["states"] > 10
    assert document["starts_s"] == [2060, 5200, 8340]
    assert document["controller_period_s"] == 3460


def test_schedule_names_the_reason_where_nothing_can_be_produced(plcemu: Run) -> None:
    outcome = plcemu("schedule", BATCH, "--load", "8", "--json")
    assert outcome.code == 1
    assert outcome.document["possible"] is False and "room" in outcome.document["reason"]


def test_half_a_load_is_scheduled_with_either_half_unless_one_is_named(plcemu: Run) -> None:
    both = plcemu("schedule", BATCH, "--load", "6.5", "--json").document["schedules"]
    one = plcemu("schedule", BATCH, "--load", "6.5", "--set", "half=water", "--json").document
    assert [s["period_s"] for s in both] == [2060, 3140]
    assert one["half"] == "water" and one["period_s"] == 3140


def test_a_load_that_does_not_exist_is_wrong_use(plcemu: Run) -> None:
    outcome = plcemu("schedule", BATCH, "--load", "9")
    assert outcome.code == 2 and "0 to 8" in outcome.err


def test_an_emitted_program_compiles_and_is_proved_safe_and_productive(
        plcemu: Run, tmp_path: Path) -> None:
    path = tmp_path / "best.sfc"
    assert plcemu("schedule", BATCH, "--load", "7", "--emit", path).code == 0
    assert plcemu("check", path).code == 0
    proved = plcemu("verify", BATCH, "--set", f"program={path}", "--set", "load=7", "--json")
    rows = {p["name"]: p["verdict"] for p in proved.document["properties"]}
    assert proved.code == 0 and rows["produces"] == rows["no_overflow"] == "holds"


def test_a_gantt_chart_is_written_as_svg(plcemu: Run, tmp_path: Path) -> None:
    path = tmp_path / "plan.svg"
    assert plcemu("schedule", BATCH, "--load", "7", "--gantt", path).code == 0
    assert "<svg" in path.read_text(encoding="utf-8")


def test_a_gantt_chart_of_several_loads_is_refused(plcemu: Run) -> None:
    outcome = plcemu("schedule", BATCH, "--load", "all", "--gantt", "x.svg")
    assert outcome.code == 2 and "one load" in outcome.err
