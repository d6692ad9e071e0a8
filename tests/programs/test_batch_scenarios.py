"""What the batch plant's monitors catch: every scenario shipped, and nothing without one."""

from __future__ import annotations

from typing import Any

import pytest
from systems import BATCH, S, batch_config

from plcemu.cli.main import main
from plcemu.runtime.scenario import Scenario, load_scenario
from plcemu.runtime.system import System

SCENARIOS = BATCH / "scenarios"

CAUGHT = [
    ("stuck_valve", 340, "B1_steady", {"BATCH_PLANT.V8": False, "BATCH_PLANT.B1_level": 41}),
    ("closed_valve", 1600, "P6_ends", {"BATCH_PLANT.P6.X": True}),
    ("lost_sensor", 360, "P1_ends", {"BATCH_PLANT.P1.X": True}),
    ("lost_temperature", 60, "plausible_temperatures", {"BATCH_PLANT.B7_temperature": 0}),
    ("drifting_sensor", 60, "B6_steady", {"BATCH_PLANT.B6_level": 1, "BATCH_PLANT.Heater": False}),
    ("leak", 420, "B1_steady", {"BATCH_PLANT.V8": False, "BATCH_PLANT.Pump1": False}),
    ("failed_heater", 3200, "P7_ends", {"BATCH_PLANT.P7.X": True}),
    ("no_coolant", 3400, "P10_ends", {"BATCH_PLANT.P10.X": True}),
    ("worn_pump", 3600, "P12_ends", {"BATCH_PLANT.P12.X": True}),
]


def violations(until_s: int, scenario: Scenario = Scenario()) -> dict[str, Any]:  # noqa: B008
    """The blamed tags of every violated property."""
    system = System(batch_config(), scenario=scenario)
    system.cycle.run_virtual(until_s * S)
    return {p["name"]: p["violation"]["blamed"] for p in system.report()["properties"]
            if p["verdict"] == "violated"}


def test_every_scenario_that_is_shipped_is_in_the_table() -> None:
    assert {path.stem for path in SCENARIOS.glob("*.yaml")} == {row[0] for row in CAUGHT}


@pytest.mark.parametrize(("name", "until_s", "caught_by", "blamed"), CAUGHT,
                         ids=[row[0] for row in CAUGHT])
def test_a_broken_plant_is_caught_and_the_right_tags_are_blamed(
        name: str, until_s: int, caught_by: str, blamed: dict[str, Any]) -> None:
    found = violations(until_s, load_scenario(SCENARIOS / f"{name}.yaml"))
    assert list(found) == [caught_by]
    assert blamed.items() <= found[caught_by].items()


def test_nothing_is_caught_in_a_sound_plant() -> None:
    assert violations(6000) == {}


def test_simulate_with_a_scenario_exits_1_and_names_property_and_tags(
        capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["simulate", str(BATCH), "--until", "60s", "--scenario",
                 str(SCENARIOS / "lost_temperature.yaml")])
    shown = capsys.readouterr().out
    assert code == 1
    assert "plausible_temperatures is violated" in shown
    assert "to blame: BATCH_PLANT.B7_temperature = 0" in shown
