"""Polyhedra against points and an independent solver; zones against polyhedra."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from plant_sim.linear import Constraint, Term, parse_constraints, parse_term
from plcemu.verify.hybrid.polyhedra import Polyhedron
from plcemu.verify.hybrid.zones import NotAZone, Scale, Zone, difference

NAMES = ("x", "y", "z")
SMALL = st.integers(-4, 4)
RELATIONS = st.sampled_from(("<=", "<", "=="))
QUICK = settings(max_examples=60, deadline=None)


def holds(constraint: Constraint, point: dict[str, Fraction]) -> bool:
    value = constraint.term.constant + sum(f * point[n] for n, f in constraint.term.factors)
    return {"<=": value <= 0, "<": value < 0, "==": value == 0}[constraint.relation]


def contains(region: Polyhedron, point: dict[str, Fraction]) -> bool:
    fixed = [Constraint(Term(((n, Fraction(1)),), -v), "==") for n, v in point.items()]
    return not region.meet(tuple(fixed)).is_empty()


@st.composite
def constraints(draw: st.DrawFn, names: tuple[str, ...] = NAMES) -> Constraint:
    factors = {n: Fraction(draw(SMALL)) for n in names}
    return Constraint(Term.of(factors, Fraction(draw(SMALL))), draw(RELATIONS))


@st.composite
def bounds_of_clocks(draw: st.DrawFn) -> Constraint:
    first, second = draw(st.permutations(("x", "y", "z", "")))[:2]
    factors = {n: Fraction(s) for n, s in ((first, 1), (second, -1)) if n}
    return Constraint(Term.of(factors, Fraction(draw(SMALL), 2)), draw(RELATIONS))


POINTS = st.fixed_dictionaries({n: st.fractions(-5, 5, max_denominator=4) for n in NAMES})
FEW = st.lists(constraints(), max_size=5)
ZONES = st.lists(bounds_of_clocks(), max_size=6)


@QUICK
@given(FEW, POINTS)
def test_a_point_is_in_a_polyhedron_if_all_constraints_hold(
        few: list[Constraint], point: dict[str, Fraction]) -> None:
    assert contains(Polyhedron.of(NAMES, few), point) == all(holds(c, point) for c in few)


@QUICK
@given(FEW, POINTS)
def test_forgetting_keeps_the_shadow(few: list[Constraint], point: dict[str, Fraction]) -> None:
    rest = {n: v for n, v in point.items() if n != "y"}
    whole = Polyhedron.of(NAMES, few)
    assert contains(whole.forget(["y"]), point) == contains(whole, rest)


@QUICK
@given(FEW, POINTS, st.fractions(0, 3, max_denominator=3), st.fractions(1, 2, max_denominator=5))
def test_what_moves_at_an_allowed_rate_is_reached(
        few: list[Constraint], point: dict[str, Fraction], time: Fraction, rate: Fraction) -> None:
    region = Polyhedron.of(NAMES, [*few, *_at(point)])
    reached = region.elapse({"x": (Fraction(1), Fraction(2)), "y": (Fraction(-1), Fraction(-1))})
    later = {**point, "x": point["x"] + rate * time, "y": point["y"] - time}
    too_far = {**point, "x": point["x"] + 2 * time + 1, "y": point["y"] - time}
    assert contains(reached, later) == all(holds(c, point) for c in few)
    assert not contains(reached, too_far)


def _at(point: dict[str, Fraction]) -> list[Constraint]:
    return [Constraint(Term(((n, Fraction(1)),), -v), "==") for n, v in point.items()]


@QUICK
@given(FEW, FEW)
def test_covering_is_what_no_point_contradicts(
        few: list[Constraint], more: list[Constraint]) -> None:
    first, second = Polyhedron.of(NAMES, few), Polyhedron.of(NAMES, few + more)
    assert first.covers(second)
    outside = any(not second.meet((n,)).is_empty() for c in few for n in c.negations)
    assert not outside


@QUICK
@given(ZONES, ZONES, POINTS)
def test_zones_and_polyhedra_agree(
        few: list[Constraint], more: list[Constraint], point: dict[str, Fraction]) -> None:
    scale = Scale(NAMES, Fraction(1, 2))
    one = {n: (Fraction(1), Fraction(1)) for n in NAMES}
    sets = {"y": (Fraction(1, 2), Fraction(2))}
    zone, region = Zone.of(scale, tuple(few)), Polyhedron.of(NAMES, few)
    for _ in range(2):
        zone = zone.elapse(one).meet(tuple(more)).assign(sets).forget(["z"])
        region = region.elapse(one).meet(tuple(more)).assign(sets).forget(["z"])
    assert zone.is_empty() == region.is_empty()
    assert zone.polyhedron().covers(region)
    assert region.covers(zone.polyhedron())
    assert contains(region, point) == contains(zone.polyhedron(), point)


@QUICK
@given(ZONES, ZONES)
def test_zones_cover_as_polyhedra_do(few: list[Constraint], more: list[Constraint]) -> None:
    scale = Scale(NAMES, Fraction(1, 2))
    first, second = Zone.of(scale, tuple(few)), Zone.of(scale, tuple(more))
    assert first.covers(second) == first.polyhedron().covers(second.polyhedron())
    assert not first.covers(second) or second.is_empty() or first.weight() >= second.weight()


@QUICK
@given(st.lists(constraints(("x", "y")), max_size=4))
def test_bounds_of_a_ratio_agree_with_a_numerical_solver(few: list[Constraint]) -> None:
    box = parse_constraints("-3 <= x <= 3 & -3 <= y <= 3")
    region = Polyhedron.of(("x", "y"), [*few, *box])
    if not region.is_empty():
        found = region.ratio(parse_term("x + 2*y"), parse_term("1"))
        best = [_best(region, sign) for sign in (1, -1)]
        assert found.low == pytest.approx(best[0], abs=1e-6)
        assert found.high == pytest.approx(-best[1], abs=1e-6)


def _best(region: Polyhedron, sign: int) -> float:
    below = [r for r in region.rows if r.relation != "=="]
    equal = [r for r in region.rows if r.relation == "=="]
    result = linprog([sign, 2 * sign], A_ub=[r.factors for r in below] or None,
                     b_ub=[-r.constant for r in below] or None,
                     A_eq=[r.factors for r in equal] or None,
                     b_eq=[-r.constant for r in equal] or None, bounds=[(None, None)] * 2,
                     method="highs")
    return float(result.fun)


def test_a_ratio_over_a_triangle_has_its_extremes_at_corners() -> None:
    region = Polyhedron.of(("x", "y"), parse_constraints("1 <= x & 1 <= y & x + y < 5"))
    found = region.ratio(parse_term("3*x"), parse_term("y"))
    assert (found.low, found.high) == (Fraction(3, 4), 12)
    assert (found.low_reached, found.high_reached) == (False, False)


def test_a_ratio_needs_a_positive_denominator() -> None:
    region = Polyhedron.of(("x",), parse_constraints("0 <= x <= 1"))
    with pytest.raises(ValueError, match="denominator"):
        region.ratio(parse_term("1"), parse_term("x"))


@pytest.mark.parametrize("text", ["x + y <= 1", "2*x - y <= 0", "x - y + z <= 0"])
def test_what_is_no_difference_of_clocks_is_refused(text: str) -> None:
    with pytest.raises(NotAZone):
        difference(parse_constraints(text)[0])
