"""Releases against a slow model that asks every instant."""

from hypothesis import given
from hypothesis import strategies as st

from plcemu.engine.releases import Releases

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
