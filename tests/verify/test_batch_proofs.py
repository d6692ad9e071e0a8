"""The batch plant proved: the real program against the plant's finite abstraction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import pytest
from systems import BATCH, S, batch_config, batch_system

from plant_sim.batch_plant.abstraction import BatchAbstraction, Ends, State, initial_loads
from plant_sim.batch_plant.loads import CONTENTS, content_of, tanks_of_load
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.processes import PROCESSES
from plant_sim.batch_plant.protocol import Protocol
from plcemu.base.trace import Frame
from plcemu.monitor import Suite, parse_properties
from plcemu.runtime.verification import make_prover
from plcemu.verify.prove import Proof
from plcemu.verify.schedules.schedule import TimedGraph, least_period


def proved(*overrides: str, names: list[str] | None = None) -> dict[str, Proof]:
    return {p.name: p for p in make_prover(batch_config(*overrides), names).prove().proofs}


def test_from_load_2_every_property_without_durations_holds_and_none_is_vacuous() -> None:
    found = proved("load=2")
    undecided = {name for name, p in found.items() if p.finding.verdict == "inconclusive"}
    assert undecided == {name for name, p in found.items() if "O[" in p.formula}
    assert {"batch_leaves", "new_batch", "P7_ends", "B3_steady"} <= undecided
    assert all(p.finding.verdict == "holds" for n, p in found.items() if n not in undecided)
    assert not [n for n, p in found.items() if p.finding.vacuous_in]


@pytest.mark.parametrize("load", ["load=0", "load=7.5", "load=8"])
def test_from_loads_that_cannot_produce_the_run_ends_in_a_standstill(load: str) -> None:
    proof = proved(load, names=["produces"])["produces"]
    assert proof.finding.verdict == "violated"
    assert proof.path is not None and proof.path.repeats_from == len(proof.path.rows) - 1


def test_half_a_batch_of_solution_gets_as_far_as_the_mixer() -> None:
    path = proved("load=0.5", names=["produces"])["produces"].path
    assert path is not None
    assert [row.action for row in path.rows if row.action] == ["P1 ends"]


def test_the_thirty_loads_are_nine_whole_ones_and_halves_of_either_kind() -> None:
    loads = [tuple(sorted(tanks.items())) for _, tanks in initial_loads()]
    assert len(loads) == len(set(loads)) == 30


@pytest.mark.parametrize(("load", "verdict"), [("load=2", "holds"), ("load=7.5", "violated")])
def test_a_standstill_is_a_deadlock(tmp_path: Any, load: str, verdict: str) -> None:
    (tmp_path / "more.prop").write_text("moves: AG EX TRUE", encoding="utf-8")
    proof = proved(load, f"verify.properties={tmp_path / 'more.prop'}", names=["moves"])["moves"]
    assert proof.finding.verdict == verdict
    assert (proof.path is not None) == (verdict == "violated")


Amounts = tuple[int, int]
"""Units of solution and of water."""

UNITS: dict[str, Amounts] = {"sol42": (1, 0), "sol84": (2, 0), "water28": (0, 1),
                             "water56": (0, 2), "sol70": (1, 1), "sol140": (2, 2), "empt": (0, 0)}


def amounts(contents: Iterable[str]) -> Amounts:
    held = [UNITS[word[:-1]] for word in contents]
    return sum(s for s, _ in held), sum(w for _, w in held)


@pytest.fixture(scope="module")
def from_everywhere() -> dict[tuple[str, ...], str]:
    """The verdict on property (1) for each of the 8100 contents of all tanks."""
    prover = make_prover(batch_config("initial=all"), ["produces"])
    proof, = prover.prove().proofs
    return {plant.tanks: proof.initial[prover.loop.plant.name_of(plant)]  # type: ignore[attr-defined]
            for plant in prover.loop.plant.initial()}


def test_all_8100_initial_configurations_have_a_verdict_in_one_run(
        from_everywhere: dict[tuple[str, ...], str]) -> None:
    assert Counter(from_everywhere.values()) == {"holds": 7825, "violated": 275}


def test_the_verdict_depends_on_the_amounts_of_solution_and_water_alone(
        from_everywhere: dict[tuple[str, ...], str]) -> None:
    by_amounts: dict[Amounts, set[str]] = {}
    for contents, verdict in from_everywhere.items():
        by_amounts.setdefault(amounts(contents), set()).add(verdict)
    assert all(len(verdicts) == 1 for verdicts in by_amounts.values())
    assert by_amounts[1, 1] == by_amounts[7, 7] == {"holds"}
    assert by_amounts[1, 6] == by_amounts[8, 2] == {"violated"}


def test_of_the_thirty_loads_those_that_cannot_produce_are_refuted(
        from_everywhere: dict[tuple[str, ...], str]) -> None:
    refuted = {name for name, tanks in initial_loads()
               if from_everywhere[tuple(tanks.get(t, "empty") for t in CONTENTS)] == "violated"}
    assert {name.split(" (")[0] for name in refuted} == {"load 0", "load 0.5", "load 7.5",
                                                         "load 8"}
    assert len(refuted) == 7


def test_where_the_controller_cannot_produce_no_schedule_can(
        from_everywhere: dict[tuple[str, ...], str]) -> None:
    refuted = [c for c, verdict in from_everywhere.items() if verdict == "violated"]
    assert not [c for c in refuted if least_period(TimedGraph(Protocol(
        BatchParameters(), dict(zip(CONTENTS, c, strict=True)))))]


def test_without_a_conflict_two_processes_share_a_tank_and_the_way_is_shown(tmp_path: Any) -> None:
    text = (BATCH / "batch_plant.sfc").read_text(encoding="utf-8")
    text = text.replace("  LD   Psi2\n  ANDN Theta1\n", "  LD   Psi2\n")
    (tmp_path / "mutant.sfc").write_text(text, encoding="utf-8")
    found = proved(f"program={tmp_path / 'mutant.sfc'}")
    assert found["no_P1_with_P2"].finding.verdict == "violated"
    assert found["no_forbidden_mixture"].finding.verdict == "violated"


def test_in_the_counterexample_the_online_monitor_violates_at_the_same_instant(
        tmp_path: Any) -> None:
    text = (BATCH / "batch_plant.sfc").read_text(encoding="utf-8")
    text = text.replace("  LD   Psi2\n  ANDN Theta1\n", "  LD   Psi2\n")
    (tmp_path / "mutant.sfc").write_text(text, encoding="utf-8")
    for proof in proved(f"program={tmp_path / 'mutant.sfc'}").values():
        if proof.finding.verdict != "violated" or proof.path is None or proof.path.repeats_from:
            continue
        trace = proof.path.trace()
        suite = Suite(parse_properties(f"it: {proof.formula}"), trace.tags)
        for frame in trace.frames:
            suite.observe(frame)
        result, = suite.finish(trace.end_ns)
        assert result.failed and result.decided_at_ns == trace.end_ns


# ---------------------------------------------------------------- refinement


class Follower:
    """Lets the abstraction follow a run of the real plant, scan by scan.

    A process ends in the abstraction once each of its tanks reads what it leaves; then the
    actuators follow. What then is no trouble, and reads what the tanks read, is allowed.
    """

    def __init__(self, plant: Any, abstraction: BatchAbstraction) -> None:
        self.plant, self.abstraction = plant, abstraction
        self.state: State = next(iter(abstraction.initial()))
        self.ended = 0

    def observe(self, frame: Frame) -> None:
        plant = self.plant.coupling.plant
        for row in self.state.running:
            change = PROCESSES[row.process].changes
            held = dict(zip(CONTENTS, self.state.tanks, strict=True))
            if not row.ended and all(_reads(plant, t, change[t][held[t]]) for t in change):
                self.state = self.abstraction.after(self.state, Ends((row.process,)))
                self.ended += 1
        self.state = self.abstraction.actuate(self.state, _actuators(plant))
        busy = {t for r in self.state.running for t in PROCESSES[r.process].changes}
        assert not self.state.trouble, (frame.t_ns, self.state)
        for tank, content in zip(CONTENTS, self.state.tanks, strict=True):
            assert tank in busy or _reads(plant, tank, content), (frame.t_ns, tank, self.state)


def _actuators(plant: Any) -> Mapping[str, bool]:
    return {name: bool(value) for name, value in plant.actuators.items()}


def _reads(plant: Any, tank: str, content: str) -> bool:
    """Whether a tank holds a content: within 0.05 l, cold up to 20.5 degC and hot above."""
    wanted = content_of(content)
    near = abs(plant.volume(tank) / plant.units.of_litres(1) - float(wanted.volume_l)) < 0.05
    if not near or tank in ("B1", "B2", "B3", "B4") or content == "empty":
        return near
    return (float(plant.temperature_degC(tank)) > 20.5) == content.endswith("H") \
        or content.startswith("sol70")


@pytest.mark.parametrize(("load", "half"), [(2, "solution"), (4.5, "water"), (7, "solution")])
def test_the_run_of_the_real_plant_is_allowed_by_the_abstraction(load: float, half: str) -> None:
    system = batch_system(f"load={load}", f"half={half}")
    follower = Follower(system.plant, BatchAbstraction({"tanks": tanks_of_load(load, half)}))
    system.cycle.observers.append(follower)
    system.cycle.run_virtual(6000 * S)
    assert follower.ended >= 9
