"""The exact feasibility test against an independent solver and by construction."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from plcemu.verify.hybrid.simplex import is_feasible

SMALL = st.integers(-6, 6)


@st.composite
def systems(draw: st.DrawFn) -> list[tuple[tuple[int, ...], int, bool]]:
    size = draw(st.integers(1, 4))
    rows = draw(st.lists(st.tuples(st.tuples(*[SMALL] * size), SMALL, st.booleans()),
                         min_size=1, max_size=9))
    return list(rows)


@given(systems())
def test_feasibility_agrees_with_scipy(rows: list[tuple[tuple[int, ...], int, bool]]) -> None:
    size = len(rows[0][0])
    # Maximise a margin that strict rows must keep; it is 0 where only the closure is met.
    above = np.array([[*factors, float(strict)] for factors, _, strict in rows])
    limits = np.array([-constant for _, constant, _ in rows])
    best = linprog([0.0] * size + [-1.0], A_ub=above, b_ub=limits,
                   bounds=[(None, None)] * size + [(0, 1)], method="highs")
    expected = best.status == 0 and (-best.fun > 1e-7)
    assert is_feasible(rows) == expected


@given(systems(), st.data())
def test_a_system_with_a_known_solution_is_feasible(
        rows: list[tuple[tuple[int, ...], int, bool]], data: st.DataObject) -> None:
    point = data.draw(st.tuples(*[SMALL] * len(rows[0][0])))
    met = [(f, -sum(a * b for a, b in zip(f, point, strict=True)) - strict, strict)
           for f, _, strict in rows]
    assert is_feasible(met)


def test_strict_rows_that_meet_in_one_point_have_no_solution() -> None:
    for strict, other in itertools.product((False, True), repeat=2):
        assert is_feasible([((1,), 0, strict), ((-1,), 0, other)]) is not (strict or other)


def test_no_rows_are_always_feasible() -> None:
    assert is_feasible([])


def test_numbers_beyond_64_bits_are_exact() -> None:
    big = 10**40
    assert is_feasible([((big,), -big - 1, False), ((-big,), big + 1, False)])
    assert not is_feasible([((big,), -big - 1, True), ((-big,), big + 1, False)])
