"""The batch plant's schedules: every load proved, beside the paper and its controller."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest
from paper_oracle import simulate
from systems import BATCH, batch_config, batch_system

from plant_sim.abstraction import Case
from plant_sim.batch_plant.loads import tanks_of_load
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.processes import PROCESSES, conflicts
from plant_sim.batch_plant.protocol import Protocol
from plcemu.runtime.scheduling import Best, Scheduler
from plcemu.verify.schedules.schedule import TimedGraph, earliest, least_period

WHOLE = {0: None, 1: 3800, 2: 2060, 3: 2060, 4: 2060, 5: 2060, 6: 2060, 7: 3140, 8: None}
HALF = {(0.5, "solution"): None, (0.5, "water"): None, (1.5, "solution"): 3180,
        (1.5, "water"): 3800, (2.5, "solution"): 2060, (2.5, "water"): 2060,
        (5.5, "water"): 2060, (6.5, "solution"): 2060, (6.5, "water"): 3140,
        (7.5, "solution"): None, (7.5, "water"): None}
LEAST_S = {**{(load, "solution"): s for load, s in WHOLE.items()}, **HALF}

PAPER_UNITS = {1: (10, 3476), 2: (25, 4968), 3: (25, 4732), 4: (25, 4774), 5: (20, 3947),
               6: (20, 4120), 7: (10, 3288)}
"""Load -> (batches, simtime in 10 s): the best of Tables 2 and 3, and 3288 from section 4.2."""

PROVED_UNITS = {**{load: row[1] for load, row in PAPER_UNITS.items()}, 3: 4706, 7: 3032}
"""What is earliest. For loads 3 and 7 that is earlier than what the paper found."""


def protocol(load: float, half: str = "solution", eager: bool = True) -> Protocol:
    return Protocol(BatchParameters(), tanks_of_load(load, half), eager)


@pytest.fixture(scope="module")
def scheduler() -> Scheduler:
    return Scheduler(batch_config())


def case(scheduler: Scheduler, load: float, half: str = "solution") -> Case:
    return next(c for c in scheduler.cases(str(load)) if c.keys.get("half", half) == half)


def best(scheduler: Scheduler, load: float, half: str = "solution", batches: int = 3) -> Best:
    return scheduler.best(case(scheduler, load, half), batches)


@pytest.mark.parametrize(("load", "half"), LEAST_S)
def test_the_least_time_per_batch_is_proved_for_every_load(
        scheduler: Scheduler, load: float, half: str) -> None:
    found = best(scheduler, load, half)
    assert found.period_s == LEAST_S[load, half]
    assert found.flaw == ""


@pytest.mark.parametrize("load", PAPER_UNITS)
def test_the_last_of_the_papers_batches_is_never_later_than_in_the_paper(load: int) -> None:
    graph = TimedGraph(protocol(load))
    batches, paper_units = PAPER_UNITS[load]
    way = earliest(graph, batches, least_period(graph))
    assert way is not None
    assert way[-1].t == PROVED_UNITS[load] <= paper_units


@pytest.mark.parametrize(("load", "half"), [(1, "solution"), (1.5, "water"), (2, "solution"),
                                            (6.5, "water"), (6.5, "solution"), (7, "solution")])
def test_the_papers_own_protocol_has_the_same_optimum(load: float, half: str) -> None:
    eager, every = (TimedGraph(protocol(load, half, e)) for e in (True, False))
    assert len(eager.states) < len(every.states)
    least = [least_period(graph) for graph in (eager, every)]
    assert least[0] is not None and least[1] is not None
    assert least[0].period == least[1].period
    first = [earliest(graph, 8, proof) for graph, proof in zip((eager, every), least, strict=True)]
    assert first[0] is not None and first[1] is not None
    assert first[0][-1].t == first[1][-1].t


@pytest.mark.parametrize(("load", "half"), [(1, "solution"), (1.5, "solution"), (2, "solution"),
                                            (4, "solution"), (6.5, "water"), (7, "solution")])
def test_the_compiled_controller_takes_what_the_papers_figures_give(
        scheduler: Scheduler, load: float, half: str) -> None:
    by_figures = simulate(dict(tanks_of_load(load, half))).period_s
    assert best(scheduler, load, half).controller == Fraction(by_figures or 0) / 10


def test_for_load_7_the_controller_loses_a_tenth_and_water_first_mends_it(
        scheduler: Scheduler) -> None:
    found = best(scheduler, 7)
    assert found.seconds(found.controller) == 3460 and found.period_s == 3140
    assert found.repair is not None
    assert found.repair.changes == (("P2", "P1"),)
    assert found.seconds(found.repair.period) == 3140


def test_the_mended_program_itself_takes_the_least_time(tmp_path: Path) -> None:
    text = (BATCH / "batch_plant.sfc").read_text(encoding="utf-8")
    before = "  LD   Psi1\n  ANDN Theta5\n  ST   Theta1\n"
    after = "  LD   Psi2\n  ANDN Theta5\n  ST   Theta2\n" + before.replace(
        "Theta5\n", "Theta5\n  ANDN Theta2\n")
    old = "  LD   Psi2\n  ANDN Theta1\n  ANDN Theta3\n  ANDN Theta5\n  ST   Theta2\n"
    assert before in text and old in text
    (tmp_path / "mended.sfc").write_text(text.replace(old, "").replace(before, after), "utf-8")
    mended = Scheduler(batch_config(f"program={tmp_path / 'mended.sfc'}"))
    for load in (1, 2, 6, 7):
        found = best(mended, load)
        assert found.seconds(found.controller) == found.period_s


def test_loads_that_cannot_produce_are_named_with_the_reason(scheduler: Scheduler) -> None:
    reasons = {load: best(scheduler, load).reason for load in (0, 0.5, 7.5, 8)}
    assert all("do not make one batch" in reasons[load] for load in (0, 0.5))
    assert all("too little room" in reasons[load] for load in (7.5, 8))


def test_processes_conflict_exactly_as_the_properties_say() -> None:
    text = (BATCH / "properties.prop").read_text(encoding="utf-8")
    assert {f"no_{a}_with_{b}" for a, b in conflicts()} == {
        line.split()[0] for line in text.splitlines() if line.startswith("no_P")}


def test_durations_and_needs_are_those_of_table_1_and_figure_6() -> None:
    from paper_oracle import FILL, SECONDS
    parameters = BatchParameters()
    for number, seconds in SECONDS.items():
        row = PROCESSES[f"P{number}"]
        assert row.duration_s(parameters) == seconds
        assert {t: tuple(words) for t, words in row.changes.items()} == \
            {t: tuple(w.replace("82", "84") for w in words) for t, words in FILL[number]}


@pytest.mark.parametrize(("load", "half", "until_s"), [(7, "solution", 15000),
                                                       (1.5, "solution", 15000)])
def test_the_written_program_keeps_the_proved_times_in_the_real_plant(
        scheduler: Scheduler, tmp_path: Path, load: float, half: str, until_s: int) -> None:
    found = best(scheduler, load, half)
    path = tmp_path / "best.sfc"
    path.write_text(scheduler.program(found), encoding="utf-8")
    system = batch_system(f"program={path}", f"load={load}", f"half={half}")
    system.cycle.run_virtual(until_s * 1_000_000_000)
    report = system.report()
    assert not [p for p in report["properties"] if p["verdict"] == "violated"]
    assert report["plant"]["period_s"] == pytest.approx(found.period_s, abs=1.0)


def test_a_program_without_priorities_cannot_be_given_a_schedule(tmp_path: Path) -> None:
    text = (BATCH / "batch_plant.sfc").read_text(encoding="utf-8")
    (tmp_path / "other.sfc").write_text(text.replace("Theta", "Choice"), "utf-8")
    other = Scheduler(batch_config(f"program={tmp_path / 'other.sfc'}"))
    with pytest.raises(Exception, match="no action Theta"):
        other.program(best(other, 7))
