"""Least periods and earliest batches, against brute force; proofs, and proofs that are wrong."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from hypothesis import given, settings
from hypothesis import strategies as st
from verify_toys import Hop, Hops, hops, least_ratio

from plcemu.verify.schedules.certificate import flaw_in
from plcemu.verify.schedules.schedule import TimedGraph, earliest, least_period, turned, way_into

TWO_LOOPS = Hops({0: [Hop(("slow",), 5, 1, 1), Hop(("fast",), 3, 1, 2)],
                  1: [Hop((), 5, 1, 1)], 2: [Hop((), 9, 2, 3)], 3: [Hop((), 3, 1, 2)]})
"""From 0 into a loop of 5 units a batch, or into one of 12 units for 3 batches."""


@settings(max_examples=200, deadline=None)
@given(hops())
def test_the_least_period_is_the_least_ratio_of_a_cycle(system: Hops) -> None:
    certificate = least_period(TimedGraph(system))
    assert (certificate and certificate.period) == least_ratio(system)


@settings(max_examples=100, deadline=None)
@given(hops())
def test_every_proof_stands_the_independent_check(system: Hops) -> None:
    certificate = least_period(TimedGraph(system))
    assert certificate is None or flaw_in(certificate, system) == ""


@settings(deadline=None)
@given(hops(), st.integers(1, 5))
def test_the_earliest_batch_is_as_early_as_in_all_runs_of_that_length(
        system: Hops, batches: int) -> None:
    graph = TimedGraph(system)
    way = earliest(graph, batches, least_period(graph))
    assert (way and way[-1].t) == _earliest_by_levels(system, batches)


def _earliest_by_levels(system: Hops, batches: int) -> int | None:
    """All (state, batches made) in order of time, unit by unit."""
    due: dict[int, set[tuple[int, int]]] = {0: {(0, 0)}}
    seen: set[tuple[int, int]] = set()
    while due:
        t = min(due)
        for state, made in due.pop(t) - seen:
            seen.add((state, made))
            for hop in system.table[state]:
                if made + hop.batches >= batches:
                    return t
                due.setdefault(t + hop.units, set()).add((hop.after, made + hop.batches))
    return None


def test_the_better_loop_is_found() -> None:
    certificate = least_period(TimedGraph(TWO_LOOPS))
    assert certificate is not None and certificate.period == 4


def test_the_way_leads_from_the_start_into_the_cycle() -> None:
    graph = TimedGraph(TWO_LOOPS)
    certificate = least_period(graph)
    assert certificate is not None
    way = way_into(graph, certificate)
    assert way[0].state == 0 and way[0].move.starts == ("fast",)
    assert turned(certificate.cycle, way[-1].move.after)[0].state == 2


def test_a_proof_of_a_smaller_period_is_refused() -> None:
    certificate = least_period(TimedGraph(TWO_LOOPS))
    assert certificate is not None
    assert "ratio" in flaw_in(replace(certificate, period=Fraction(3)), TWO_LOOPS) \
        or "cheaper" in flaw_in(replace(certificate, period=Fraction(3)), TWO_LOOPS)


def test_a_proof_with_a_changed_potential_is_refused() -> None:
    certificate = least_period(TimedGraph(TWO_LOOPS))
    assert certificate is not None
    changed = {**certificate.potentials, 3: certificate.potentials[3] + 1}
    assert "cheaper" in flaw_in(replace(certificate, potentials=changed), TWO_LOOPS)


def test_a_proof_that_leaves_out_a_state_is_refused() -> None:
    certificate = least_period(TimedGraph(TWO_LOOPS))
    assert certificate is not None
    partial = {s: h for s, h in certificate.potentials.items() if s != 1}
    assert "no potential" in flaw_in(replace(certificate, potentials=partial), TWO_LOOPS)


def test_a_proof_for_another_system_is_refused() -> None:
    certificate = least_period(TimedGraph(TWO_LOOPS))
    other = Hops({**TWO_LOOPS.table, 3: [Hop((), 2, 1, 2)]})
    assert certificate is not None
    assert flaw_in(certificate, other) != ""


def test_a_system_that_comes_to_rest_has_no_period() -> None:
    assert least_period(TimedGraph(Hops({0: [Hop((), 1, 1, 1)], 1: []}))) is None
