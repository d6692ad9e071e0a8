"""Exact lines, crossings and readings, against a search ns by ns."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.lines import NEVER_NS, Form, Line, exact, first_not_negative, first_positive
from plant_sim.readings import Reading, Rounding

SMALL = st.integers(-40, 40)
RATIO = Form((("a", 1),)), Form((("b", 2),))


def test_a_line_is_rounded_to_the_nearest_quantum() -> None:
    line = Line(10, 1, 3, t0_ns=100)
    assert [line.at(100 + dt) for dt in range(7)] == [10, 10, 11, 11, 11, 12, 12]


def test_a_line_that_keeps_its_slope_keeps_its_anchor() -> None:
    line = Line(10, 1, 3, t0_ns=100)
    assert line.with_slope(Fraction(2, 6), 150) is line
    assert line.with_slope(Fraction(-1, 3), 103) == Line(11, -1, 3, 103)


@given(value=SMALL, slope=SMALL)
def test_a_crossing_is_the_first_ns_at_which_it_has_happened(value: int, slope: int) -> None:
    reached = [dt for dt in range(100) if value + slope * dt >= 0]
    passed = [dt for dt in range(100) if value + slope * dt > 0]
    assert first_not_negative(value, slope) == min(reached, default=NEVER_NS)
    assert first_positive(value, slope) == min(passed, default=NEVER_NS)


@given(
    a=st.builds(Line, st.integers(0, 50), st.integers(0, 9), st.integers(1, 4)),
    b=st.builds(Line, st.integers(0, 9), st.integers(0, 3), st.integers(1, 4)),
    rounding=st.sampled_from(Rounding),
)
def test_the_next_change_of_a_quotient_is_the_first_ns_with_another_count(
    a: Line, b: Line, rounding: Rounding
) -> None:
    lines = {"a": a, "b": b}
    reading = Reading(*RATIO, rounding, low=0, high=20, undefined=7)
    count, change_ns = reading.read(lines, 0)
    end_ns = min(change_ns, 400)
    assert all(reading.read(lines, t_ns)[0] == count for t_ns in range(end_ns))
    assert change_ns == NEVER_NS or reading.read(lines, change_ns)[0] != count


@pytest.mark.parametrize(("value", "count"), [(0, 0), (1, 1), (10, 1), (11, 2), (20, 2)])
def test_a_ceiling_reads_k_above_k_minus_one_and_up_to_k(value: int, count: int) -> None:
    reading = Reading(Form((("a", 1),)), Form((), 10), Rounding.CEILING, low=0, high=99)
    assert reading.read({"a": Line(value)}, 0)[0] == count


def test_a_float_is_taken_as_the_decimal_it_was_written_as() -> None:
    assert exact(0.1) == Fraction(1, 10)
