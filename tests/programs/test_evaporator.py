"""The evaporator's closed loop: the paper's two runs, its two forms of the controller, mutants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from systems import ROOT, S

from plcemu.base.trace import Trace
from plcemu.runtime.config import load_config
from plcemu.runtime.scenario import Scenario, parse_fault
from plcemu.runtime.system import System

EVAPORATOR = ROOT / "il_programs" / "evaporator"
CHART = (EVAPORATOR / "evaporator.sfc").read_text(encoding="utf-8")
STEPS = ("X1", "X2", "X3", "X4", "X5", "X6", "X7", "X11", "X12", "X13", "X21")
OUTPUTS = ("V1", "V2", "V3", "V4", "H", "MR", "Alarm")
SLOW_DRAIN = "A2=0.017369"
"""Area of a hole through which tank 2 runs empty in the 26 s that the paper's formal model has."""


def faults(*texts: str) -> Scenario:
    return sum((parse_fault(text) for text in texts), Scenario())


MALFUNCTION = faults("condenser malfunction at 15s")


def simulated(until_s: float, *overrides: str, scenario: Scenario = Scenario(),  # noqa: B008
              ) -> tuple[System, Trace]:
    system = System(load_config(EVAPORATOR, overrides), scenario=scenario)
    trace = Trace(system.cycle.tags)
    system.cycle.observers.append(trace)
    system.cycle.run_virtual(round(until_s * S))
    return system, trace


def since_s(trace: Trace, tag: str, value: Any = True) -> list[float]:
    """When a tag took a value, s."""
    return [t / S for t, v in trace.history(tag) if v == value]


# The paper's runs


def test_the_normal_run_has_the_event_times_of_the_paper() -> None:
    _, trace = simulated(66.5, "cycle=1ms")
    found = [since_s(trace, "plant.T1F")[0], since_s(trace, "EVAPORATOR.H")[0],
             since_s(trace, "EVAPORATOR.H", False)[1], since_s(trace, "plant.T1E")[1],
             since_s(trace, "EVAPORATOR.V4")[0], since_s(trace, "plant.T2E")[1]]
    assert found == pytest.approx([0.667, 2.667, 22.667, 24.925, 56.925, 65.957], abs=0.006)


def test_a_malfunction_at_15_s_is_answered_as_in_the_paper() -> None:
    system, trace = simulated(30, "cycle=1ms", scenario=MALFUNCTION)
    assert since_s(trace, "EVAPORATOR.Alarm") == [15.0]
    assert since_s(trace, "EVAPORATOR.H", False)[1] == since_s(trace, "EVAPORATOR.MR", False)[1] \
        == 15.0
    assert since_s(trace, "plant.T1E")[1] == pytest.approx(17.26, abs=0.005)
    assert {p["verdict"] for p in system.report()["properties"]} <= {"presumably satisfied"}


def test_after_the_repair_the_evaporator_starts_anew() -> None:
    repaired = faults("condenser malfunction at 15s until 40s")
    _, trace = simulated(50, scenario=repaired)
    assert since_s(trace, "X1.X") == [0.0, 40.0]
    assert since_s(trace, "EVAPORATOR.H")[1] == pytest.approx(42.7, abs=0.05)


@pytest.mark.parametrize("at_s", [0, 0.3, 1, 2.67, 10, 22.6, 23, 24.9, 30, 56.95, 60])
def test_nothing_bad_comes_of_a_malfunction_whenever_it_begins(at_s: float) -> None:
    system, _ = simulated(150, SLOW_DRAIN, "cycle=20ms",
                          scenario=faults(f"condenser malfunction at {at_s}s until {at_s + 60}s"))
    assert {p["verdict"] for p in system.report()["properties"]} <= {"presumably satisfied"}


# The algebraic form


@pytest.mark.parametrize("scenario", [
    Scenario(), MALFUNCTION, faults("condenser malfunction at 57s until 66s"),
    faults("condenser malfunction at 1s until 1.01s", "T1F stuck at 25.2s"),
    faults("condenser malfunction at 24.94s until 24.98s")],
    ids=["normal", "malfunction", "late", "stuck", "short"])
def test_chart_and_algebraic_form_give_the_same_trace(scenario: Scenario) -> None:
    algebraic = f"program={EVAPORATOR / 'evaporator_algebraic.st'}"
    _, chart = simulated(70, "cycle=20ms", scenario=scenario)
    _, equations = simulated(70, "cycle=20ms", algebraic, "properties=[]", scenario=scenario)
    for name in OUTPUTS:
        assert equations.history(f"EVAPORATOR.{name}") == chart.history(f"EVAPORATOR.{name}")
    for step in STEPS:
        assert equations.history(f"EVAPORATOR.{step}") == chart.history(f"{step}.X")


# Mutants: each makes the plant do what the property forbids


def mutant(folder: Path, *changes: tuple[str, str]) -> str:
    text = CHART
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = folder / "mutant.sfc"
    path.write_text(text, encoding="utf-8")
    return f"program={path}"


HEATER_STAYS_ON = (("TRANSITION FROM X3 TO X11 := Malf; END_TRANSITION\n", ""),)
HEATER_IN_X11 = (("let tank 2 run empty *)\n  Alarm(N);", "*)\n  Alarm(N);\n  H(N);"),)
V3_TOO_EARLY = (("V3 := X5.X;", "V3 := TRUE;"), ("NOT X6.X AND ", ""))
X2_WITHOUT_X6 = (("NOT X6.X AND ", ""),)


@pytest.mark.parametrize(("changes", "scenario", "hazard"), [
    (HEATER_STAYS_ON, MALFUNCTION, "PS1"),
    (HEATER_IN_X11, faults("condenser malfunction at 57.5s"), "PS1"),
    (V3_TOO_EARLY, Scenario(), "PS3"),
    (X2_WITHOUT_X6, Scenario(), "PS4"),
], ids=["heater stays on", "heater in X11", "V3 too early", "X2 without X6"])
def test_a_mutant_brings_the_hazard_about(tmp_path: Path, changes: tuple[tuple[str, str], ...],
                                          scenario: Scenario, hazard: str) -> None:
    system, _ = simulated(150, SLOW_DRAIN, "cycle=20ms", mutant(tmp_path, *changes),
                          scenario=scenario)
    sound, _ = simulated(150, SLOW_DRAIN, "cycle=20ms", scenario=scenario)
    violated = {p["name"] for p in system.report()["properties"] if p["verdict"] == "violated"}
    assert hazard in violated
    assert all(p["verdict"] != "violated" for p in sound.report()["properties"])
