"""What is measured of a task, against exact percentiles."""

import math

from hypothesis import given
from hypothesis import strategies as st

from plcemu.engine.statistics import Durations, Histogram

durations = st.lists(st.integers(0, 200) | st.integers(0, 10**7) | st.integers(0, 2**63 - 1),
                     min_size=1, max_size=60)


def exact(values, percent):
    """Return the nearest-rank percentile."""
    return sorted(values)[math.ceil(len(values) * percent / 100) - 1]


def filled(values):
    histogram = Histogram()
    for value in values:
        histogram.add(value)
    return histogram


@given(durations, st.integers(1, 100))
def test_a_percentile_is_never_too_small_and_too_large_by_less_than_a_64th(values, percent):
    told, truth = filled(values).percentile_ns(percent), exact(values, percent)
    assert truth <= told
    assert (told - truth) * 64 <= truth


@given(st.lists(st.integers(0, 127), min_size=1, max_size=60), st.integers(1, 100))
def test_a_percentile_of_short_durations_is_exact(values, percent):
    assert filled(values).percentile_ns(percent) == exact(values, percent)


def test_memory_is_bounded_whatever_is_measured():
    edges = [(1 << bits) + k * max(1, (1 << bits) // 64) for bits in range(63) for k in range(64)]
    assert len(filled([*range(128), *edges, *(e + 1 for e in edges)])) <= 128 + 57 * 64


def test_of_nothing_everything_is_0():
    nothing = Durations()
    assert (nothing.last_ns, nothing.min_ns, nothing.max_ns, nothing.mean_ns, nothing.p99_ns) == (
        0, 0, 0, 0, 0)


@given(durations)
def test_last_extremes_and_mean_are_exact(values):
    measured = Durations()
    for value in values:
        measured.add(value)
    assert (measured.last_ns, measured.min_ns, measured.max_ns, measured.mean_ns) == (
        values[-1], min(values), max(values), sum(values) // len(values))
    assert exact(values, 99) <= measured.p99_ns <= max(values)


def test_a_clock_that_went_back_counts_as_no_time():
    measured = Durations()
    measured.add(-5)
    assert (measured.min_ns, measured.max_ns) == (0, 0)
