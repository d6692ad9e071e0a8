"""The evaporator proved in time: the paper's verdicts, mutants, and the real drain of tank 1."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import NamedTuple

import pytest
from systems import ROOT, S

from plant_sim.evaporator import EvaporatorParameters
from plant_sim.evaporator.abstraction import torricelli_s
from plcemu.monitor import Suite, parse_properties
from plcemu.runtime.config import load_config
from plcemu.runtime.scenario import load_scenario
from plcemu.runtime.system import System
from plcemu.runtime.verification import make_prover
from plcemu.verify.path import Path as Run
from plcemu.verify.prove import Proof

FOLDER = ROOT / "il_programs/evaporator"
CHART = (FOLDER / "evaporator.sfc").read_text(encoding="utf-8")
PAPER = {*(f"PC{n}" for n in range(1, 13)), "PS1", "PS2", "PS3"}
NO_SOLID = "PS4"
TIMES = ["integer", "zones"]
REAL_DRAIN = "verify.parameters.drain=torricelli"


def proved(*overrides: str, names: list[str] | None = None) -> dict[str, Proof]:
    config = load_config(FOLDER, list(overrides))
    return {p.name: p for p in make_prover(config, names).prove().proofs}


def named(proofs: dict[str, Proof], verdict: str) -> set[str]:
    return {name for name, p in proofs.items() if p.finding.verdict == verdict}


def shown(proofs: dict[str, Proof], name: str) -> Run:
    path = proofs[name].path
    assert path is not None
    return path


# ---------------------------------------------------------------- the paper


@pytest.mark.parametrize("time", TIMES)
def test_all_that_the_paper_proves_holds_and_nothing_becomes_solid(time: str) -> None:
    proofs = proved(f"verify.time={time}")
    assert named(proofs, "holds") >= {*PAPER, NO_SOLID}
    assert named(proofs, "violated") == set()
    assert not [name for name, p in proofs.items() if p.finding.vacuous_in]


def test_the_other_properties_hold_too() -> None:
    assert named(proved(), "holds") - PAPER == {NO_SOLID, "heater_off", "V4_first",
                                                "heater_in_X3", "alarm"}


@pytest.mark.parametrize("time", TIMES)
def test_the_other_form_of_the_controller_has_the_same_verdicts(time: str) -> None:
    names = ["PS1", "PS2", "PS3", NO_SOLID, "PC1"]
    proofs = proved(f"verify.time={time}", "program=evaporator_algebraic.st", names=names)
    assert named(proofs, "holds") == set(names)


# ---------------------------------------------------------------- mutants


HEATER_STAYS_ON = (("TRANSITION FROM X3 TO X11 := Malf; END_TRANSITION\n", ""),)
HEATER_IN_X11 = (("let tank 2 run empty *)\n  Alarm(N);", "*)\n  Alarm(N);\n  H(N);"),)
V3_TOO_EARLY = (("V3 := X5.X;", "V3 := TRUE;"), ("NOT X6.X AND ", ""))
X2_WITHOUT_X6 = (("NOT X6.X AND ", ""),)
MUTANTS = [(HEATER_STAYS_ON, "PS1"), (HEATER_IN_X11, "PS1"), (V3_TOO_EARLY, "PS3"),
           (X2_WITHOUT_X6, NO_SOLID)]
NAMES = ["heater stays on", "heater in X11", "V3 too early", "X2 without X6"]


def mutant(folder: Path, *changes: tuple[str, str]) -> str:
    text = CHART
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = folder / "mutant.sfc"
    path.write_text(text, encoding="utf-8")
    return f"program={path}"


class Refuted(NamedTuple):
    """A mutant, and the proof that its hazard comes about."""

    program: str
    proof: Proof
    path: Run


@pytest.fixture(scope="module", params=product(MUTANTS, TIMES),
                ids=[f"{name}, {time}" for name, time in product(NAMES, TIMES)])
def refuted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Refuted:
    (changes, hazard), time = request.param
    program = mutant(tmp_path_factory.mktemp("mutant"), *changes)
    proofs = proved(f"verify.time={time}", program, names=[hazard])
    return Refuted(program, proofs[hazard], shown(proofs, hazard))


def test_a_mutant_is_refuted(refuted: Refuted) -> None:
    assert refuted.proof.finding.verdict == "violated"


def test_the_online_monitor_says_so_at_the_end_of_the_run(refuted: Refuted) -> None:
    trace = refuted.path.trace()
    suite = Suite(parse_properties(f"it: {refuted.proof.formula}"), trace.tags)
    for frame in trace.frames:
        suite.observe(frame)
    result, = suite.finish(trace.end_ns)
    assert result.failed and result.decided_at_ns == refuted.path.ends_at_ns


def test_the_counterexample_plays_in_simulate_scan_by_scan(refuted: Refuted,
                                                           tmp_path: Path) -> None:
    """The same program at its real cycle, without a plant, does what the path's scans show."""
    config = load_config(FOLDER, [refuted.program])
    file = tmp_path / "run.yaml"
    file.write_text(refuted.path.scenario("it", make_prover(config).loop.inputs), encoding="utf-8")
    system = System(config, with_plant=False, scenario=load_scenario(file))
    memory = system.cycle.resource.memory
    told = range(len(memory.tags))
    for row in refuted.path.rows:
        system.cycle.lap()
        now = dict(memory.values())
        assert [now[n] for n in told] == [row.values[n] for n in told]


# ---------------------------------------------------------------- the real drain


def test_the_drain_time_of_the_parameters_is_enclosed() -> None:
    low, high = torricelli_s(EvaporatorParameters())
    exact_squared = Fraction(2) / Fraction("9.80665") * 25
    assert low ** 2 <= exact_squared <= high ** 2
    assert high - low == Fraction("0.001")


def test_with_the_real_drain_the_paper_s_properties_hold_but_it_may_become_solid() -> None:
    proofs = proved(REAL_DRAIN)
    assert named(proofs, "holds") >= PAPER
    assert named(proofs, "violated") == {NO_SOLID}
    story = [row.action for row in shown(proofs, NO_SOLID).rows if row.action]
    assert story[-3:] == ["the condenser fails", "the steam ends", "the solution becomes solid"]


def test_it_cannot_if_only_that_of_a_full_tank_can() -> None:
    """The reading notes' words: "the solution of a full tank 1"."""
    assert named(proved(REAL_DRAIN, "verify.parameters.solid=full"), "violated") == set()


@pytest.mark.parametrize(("empty_s", "verdict"), [("23.241", "holds"), ("23.242", "violated")])
def test_it_may_from_the_emptying_time_on_that_the_budget_gives(empty_s: str,
                                                               verdict: str) -> None:
    """Waiting for tank 2 after the heater, a drain broken off, tank 2 again, the rest drained:
    (e - 20) + 2.258 + e + 2.258 >= 12 + 19."""
    proofs = proved("verify.parameters.drain=2.258", f"verify.parameters.empty_s={empty_s}",
                    names=[NO_SOLID])
    assert proofs[NO_SOLID].finding.verdict == verdict


def test_the_continuous_plant_agrees_that_it_becomes_solid() -> None:
    config = load_config(FOLDER, ["A2=0.017369"])
    scenario = load_scenario(FOLDER / "scenarios/solidification.yaml")
    system = System(config, scenario=scenario)
    system.cycle.run_virtual(130 * S)
    violated = {p["name"]: p["decided_at_s"] for p in system.report()["properties"]
                if p["verdict"] == "violated"}
    assert set(violated) == {NO_SOLID}
    assert violated[NO_SOLID] == pytest.approx(76.95 + 12 + 19, abs=0.05)
