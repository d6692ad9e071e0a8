"""Releases of several tasks together, against a slow model that asks every instant."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.engine import timetable
from plcemu.engine.jitter import Jitter, JitteredReleases
from plcemu.engine.releases import Releases
from plcemu.engine.timetable import count_any, together

progressions = st.builds(Releases, st.integers(0, 40), st.integers(1, 30))
jittered = st.builds(JitteredReleases, st.integers(0, 40), st.integers(5, 30),
                     st.builds(Jitter, st.just(Fraction(1, 3)), st.booleans(), st.integers(0, 9)),
                     st.sampled_from("ab"))
instants = st.integers(0, 200)
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43)


@given(st.lists(progressions, max_size=6), instants, instants)
def test_instants_of_several_are_counted_once(many, first, before):
    expected = {t for t in range(first, before) if any(each.is_due(t) for each in many)}
    assert count_any(many, first, before) == len(expected)


def test_a_year_of_many_tasks_is_counted_at_once():
    tasks = [Releases(0, step * 1_000_000) for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)]
    assert together(tasks).count(0, 365 * 86_400 * 10**9) == 365 * 86_400_000


@given(st.lists(progressions | jittered, min_size=1, max_size=5), instants, instants)
def test_several_schedules_are_one(many, first, before):
    one = together(many)
    due = [t for t in range(400) if any(each.is_due(t) for each in many)]
    inside = [t for t in due if first <= t < before]
    assert one.first(first) == min(t for t in due if t >= first)
    assert one.last(before) == max((t for t in due if t < before), default=-1)
    assert one.is_due(first) is (first in due)
    assert one.count(first, before) == len(inside) == len(one.within(first, before))


@given(st.lists(st.sampled_from(PRIMES), min_size=9, max_size=12, unique=True))
@settings(max_examples=20)
def test_more_intervals_than_can_be_counted_in_closed_form_are_counted_one_by_one(steps):
    one = together(Releases(0, step) for step in steps)
    assert one.count(0, 3000) == sum(any(t % step == 0 for step in steps) for t in range(3000))


def test_of_very_many_releases_only_some_are_in_memory_at_once(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(timetable, "_AT_ONCE", 100)
    one = together(Releases(1, step) for step in PRIMES)
    assert one.count(0, 9001) == sum(any(t % step == 0 for step in PRIMES) for t in range(9000))


def test_of_tasks_whose_intervals_are_multiples_only_the_fastest_counts():
    fastest = Releases(0, 10)
    assert together([Releases(20, 20), fastest, Releases(50, 100), fastest]) is fastest
