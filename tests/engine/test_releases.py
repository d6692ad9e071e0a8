"""Releases against a slow model that asks every instant."""

from hypothesis import given
from hypothesis import strategies as st

from plcemu.engine.releases import Releases
from plcemu.engine.timetable import count_any

progressions = st.builds(Releases, st.integers(0, 40), st.integers(1, 30))
instants = st.integers(0, 200)


def slow(releases, first, before):
    """Return the instants in [first, before), taken from the definition: start + k · step."""
    return {t for k in range(1100) if first <= (t := releases.start + k * releases.step) < before}


@given(progressions, instants)
def test_the_first_and_the_last_release_are_those_of_the_definition(releases, t):
    assert releases.first(t) == min(slow(releases, t, 1000))
    assert releases.last(t) == max(slow(releases, 0, t), default=-1)
    assert releases.is_due(t) is (t in slow(releases, 0, t + 1))


@given(progressions, instants, instants)
def test_releases_are_counted_as_if_one_by_one(releases, first, before):
    assert releases.count(first, before) == len(slow(releases, first, before))


@given(progressions, progressions)
def test_what_two_share_is_a_progression_again(one, other):
    shared = slow(one, 0, 400) & slow(other, 0, 400)
    both = one.meet(other)
    assert shared == (slow(both, 0, 400) if both is not None else set())


@given(st.lists(progressions, max_size=6), instants, instants)
def test_instants_of_several_are_counted_once(many, first, before):
    expected = set().union(*(slow(each, first, before) for each in many))
    assert count_any(many, first, before) == len(expected)


def test_a_year_of_many_tasks_is_counted_at_once():
    tasks = [Releases(0, step * 1_000_000) for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)]
    assert count_any(tasks, 0, 365 * 86_400 * 10**9) == 365 * 86_400_000
