"""The batch plant as shipped, in virtual time, against the paper's controller."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import pytest
from paper_oracle import simulate
from systems import S, batch_system

from plant_sim.batch_plant.loads import tanks_of_load
from plcemu.base.trace import Trace

pytestmark = pytest.mark.acceptance

LOADS = [(1, "solution", 3800, 20_000), *((load, "solution", 2060, 14_500) for load in range(2, 7)),
         (7, "solution", 3460, 20_000)]
HALVES = [(2.5, "water", 2060, 12_500), (4.5, "solution", 2060, 12_500),
          (6.5, "water", 3460, 18_000)]
BARREN = [(load, half) for load in (0, 0.5, 7.5, 8) for half in ("solution", "water")]


def run(load: float, half: str, until_s: int) -> tuple[Any, list[tuple[int, int]]]:
    """Return the report, and when which process started, in order: (ns, process)."""
    system = batch_system(f"load={load}", f"half={half}")
    trace = Trace(system.cycle.tags)
    system.cycle.observers.append(trace)
    system.cycle.run_virtual(until_s * S)
    starts = [(t, n) for n in range(1, 13) for t, on in trace.history(f"P{n}.X") if on]
    return system.report(), sorted(starts)


@pytest.mark.parametrize(("load", "half", "period_s", "until_s"), LOADS + HALVES)
def test_the_batch_plant_does_what_the_paper_s_controller_does(load: float, half: str,
                                                               period_s: int,
                                                               until_s: int) -> None:
    report, starts = run(load, half, until_s)
    oracle = simulate(tanks_of_load(load, half)).starts
    # What the paper's controller starts at one instant is started in any order within some scans.
    expected = [sorted(n for _, n in group) for _, group in groupby(oracle, key=lambda e: e[0])]
    numbers = iter(n for _, n in starts)
    found = [sorted(n for _, n in zip(group, numbers, strict=False)) for group in expected]
    complete = [group for group in found if group][:-1]
    assert complete == expected[:len(complete)]
    assert len(starts) > 30
    assert report["plant"]["period_s"] == pytest.approx(period_s, abs=3)
    assert report["plant"]["produces"] and report["plant"]["reason"] == ""
    assert {p["verdict"] for p in report["properties"]} <= {"satisfied", "presumably satisfied"}


@pytest.mark.parametrize(("load", "half"), BARREN)
def test_too_little_or_too_much_produces_nothing_and_says_so(load: float, half: str) -> None:
    report, _ = run(load, half, 15_000)
    assert report["plant"]["batches"] == 0 and report["plant"]["produces"] is False
    assert report["plant"]["reason"]
    violated = {p["name"] for p in report["properties"] if p["verdict"] == "violated"}
    assert violated <= {"new_batch", "batch_leaves"}
