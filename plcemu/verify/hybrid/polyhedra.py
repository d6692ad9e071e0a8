"""Convex polyhedra with rational bounds, open or closed, in exact integer arithmetic.

A polyhedron is a set of rows `a·x + b REL 0` with whole numbers. Variables are eliminated by
Fourier and Motzkin's method: equations are put in first, and a row that stems from more rows than
variables were eliminated, plus one, is implied by others (Chernikov; Kohler). This is the readable
and general form of regions; `zones` is the quick one, for clocks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd, lcm
from typing import NamedTuple, Self

from plant_sim.linear import Constraint, Constraints, Term
from plant_sim.linear_automaton import Interval
from plcemu.base.errors import LimitError
from plcemu.verify.hybrid.simplex import Inequality, is_feasible

ROW_LIMIT = 5_000
"""Rows that one elimination may make."""


class Row(NamedTuple):
    """`factors · x + constant` is below, at most or equal to zero."""

    factors: tuple[int, ...]
    constant: int
    relation: str


class Bounds(NamedTuple):
    """Between what a quantity lies; None is without bound.

    Attributes:
        low, high: its infimum and supremum.
        low_reached, high_reached: whether it takes these values.
    """

    low: Fraction | None
    high: Fraction | None
    low_reached: bool = True
    high_reached: bool = True


@dataclass(frozen=True, slots=True)
class Polyhedron:
    """A convex set of points; the order of variables is fixed."""

    variables: tuple[str, ...]
    rows: tuple[Row, ...]

    @classmethod
    def of(cls, variables: Sequence[str], constraints: Iterable[Constraint]) -> Self:
        """Return the points at which all constraints hold."""
        names = tuple(variables)
        return cls(names, tuple(_tidy(_row(names, c) for c in constraints)))

    def meet(self, constraints: Constraints) -> Self:
        """Return the points of this set at which constraints hold."""
        more = [_row(self.variables, c) for c in constraints]
        return type(self)(self.variables, tuple(_tidy([*self.rows, *more])))

    def is_empty(self) -> bool:
        """Whether there is no point."""
        return not _solvable(self.rows)

    def covers(self, other: Self) -> bool:
        """Whether every point of another set is one of this."""
        return all(not _solvable([*other.rows, opposite])
                   for row in self.rows for opposite in _opposites(row))

    def weight(self) -> tuple[int, int]:
        """Return the same for all: whether one covers another cannot be told from a number."""
        return 0, 0

    def forget(self, names: Iterable[str]) -> Self:
        """Let variables be anything."""
        rows: Sequence[Row] = self.rows
        for name in names:
            rows = _eliminate(rows, self.variables.index(name))
        return type(self)(self.variables, tuple(rows))

    def assign(self, sets: Mapping[str, Interval]) -> Self:
        """Set variables to any value of an interval."""
        fixed = [Constraint(term, "<=") for name, (low, high) in sets.items()
                 for term in (Term(((name, Fraction(1)),), -high),
                              Term(((name, Fraction(-1)),), low))]
        return self.forget(sets).meet(tuple(fixed))

    def elapse(self, rates: Mapping[str, Interval]) -> Self:
        """Let any time pass: variables move at any rate of their interval, others stay.

        The points reached are those from which a step back for some time ends in this set, so
        the starting point and the time are eliminated.
        """
        moving = [v for v in self.variables if rates.get(v, (0, 0)) != (0, 0)]
        size, extra = len(self.variables), len(moving) + 1
        rows = [Row(r.factors + (0,) * extra, r.constant, r.relation) for r in self.rows]
        # Columns: present values, then how far each has moved, then the time that has passed.
        for k, name in enumerate(moving):
            i = self.variables.index(name)
            rows = [_with(r, size + k, -r.factors[i]) for r in rows]
        for k, name in enumerate(moving):
            low, high = rates[name]
            rows.append(_moved(size, extra, k, Fraction(1), -high))
            rows.append(_moved(size, extra, k, Fraction(-1), low))
        rows.append(Row((0,) * (size + extra - 1) + (-1,), 0, "<="))
        for column in range(size + extra - 1, size - 1, -1):
            rows = list(_eliminate(rows, column))
        return type(self)(self.variables, tuple(Row(r.factors[:size], r.constant, r.relation)
                                                for r in _needed(rows)))

    def ratio(self, above: Term, below: Term) -> Bounds:
        """Return the bounds of `above / below`, which must be positive throughout.

        The set is made a cone by a scale (Charnes and Cooper, 1962), so that the ratio is linear.

        Raises:
            ValueError: `below` is not positive everywhere.
        """
        if not self.meet((Constraint(below, "<="),)).is_empty():
            raise ValueError("the denominator is not positive everywhere")
        size = len(self.variables)
        # Columns: scaled values, the scale, the ratio.
        rows = [Row((*r.factors, r.constant, 0), 0, r.relation) for r in self.rows]
        rows.append(Row((0,) * size + (-1, 0), 0, "<"))
        rows.append(_scaled(self.variables, below, 0, Fraction(-1)))
        rows.append(_scaled(self.variables, above, -1, Fraction(0)))
        for column in range(size + 1):
            rows = list(_eliminate(rows, column))
        return _bounds(rows, size + 1)


def _scaled(names: Sequence[str], term: Term, ratio: int, constant: Fraction) -> Row:
    factors = dict(term.factors)
    values = [*(factors.get(n, Fraction(0)) for n in names), term.constant, Fraction(ratio),
              constant]
    whole = _whole(values)
    return Row(tuple(whole[:-1]), whole[-1], "==")


def _bounds(rows: Iterable[Row], column: int) -> Bounds:
    low: tuple[Fraction, bool] | None = None
    high: tuple[Fraction, bool] | None = None
    for row in rows:
        factor = row.factors[column]
        if factor == 0:
            continue
        place = (Fraction(-row.constant, factor), row.relation != "<")
        if (factor > 0 or row.relation == "==") and (high is None or place < high):
            high = place
        if (factor < 0 or row.relation == "==") and (
                low is None or (place[0], not place[1]) > (low[0], not low[1])):
            low = place
    return Bounds(low[0] if low else None, high[0] if high else None,
                  low[1] if low else False, high[1] if high else False)


# ------------------------------------------------------------ rows


def _whole(values: Sequence[Fraction]) -> list[int]:
    scale = lcm(*(v.denominator for v in values))
    return [int(v * scale) for v in values]


def _row(names: Sequence[str], constraint: Constraint) -> Row:
    factors = dict(constraint.term.factors)
    unknown = set(factors) - set(names)
    if unknown:
        raise ValueError(f"{', '.join(sorted(unknown))} is no variable of the polyhedron")
    whole = _whole([*(factors.get(n, Fraction(0)) for n in names), constraint.term.constant])
    return Row(tuple(whole[:-1]), whole[-1], constraint.relation)


def _with(row: Row, column: int, factor: int) -> Row:
    factors = list(row.factors)
    factors[column] = factor
    return Row(tuple(factors), row.constant, row.relation)


def _moved(size: int, extra: int, k: int, sign: Fraction, rate: Fraction) -> Row:
    """Return `sign * moved + rate * time <= 0`."""
    values = [Fraction(0)] * (size + extra)
    values[size + k], values[-1] = sign, rate
    return Row(tuple(_whole(values)), 0, "<=")


def _opposites(row: Row) -> list[Row]:
    back = Row(tuple(-f for f in row.factors), -row.constant, "<")
    if row.relation == "==":
        return [back, Row(row.factors, row.constant, "<")]
    return [back] if row.relation == "<=" else [Row(back.factors, back.constant, "<=")]


def _tidy(rows: Iterable[Row]) -> list[Row]:
    """Return rows in normal form: divided by their greatest divisor, of parallel ones the
    strongest, none that is always true; a contradiction alone."""
    equal: dict[tuple[int, ...], Fraction] = {}
    below: dict[tuple[int, ...], Row] = {}
    for row in rows:
        divisor = gcd(*row.factors)
        if divisor == 0:
            if _holds(row.constant, row.relation):
                continue
            return [Row(row.factors, 1, "<=")]
        slope = tuple(f // divisor for f in row.factors)
        if row.relation == "==":
            if next(f for f in slope if f) < 0:
                slope, divisor = tuple(-f for f in slope), -divisor
            value = Fraction(row.constant, divisor)
            if equal.setdefault(slope, value) != value:
                return [Row((0,) * len(slope), 1, "<=")]
            continue
        known = below.get(slope)
        if known is None or _stronger(row, divisor, known):
            # Kept over the divisor's multiple, so that numbers stay whole.
            common = gcd(divisor, row.constant)
            below[slope] = Row(tuple(f // common for f in row.factors), row.constant // common,
                               row.relation)
    equations = (Row(tuple(f * c.denominator for f in slope), c.numerator, "==")
                 for slope, c in equal.items())
    return [*equations, *below.values()]


def _stronger(row: Row, divisor: int, known: Row) -> bool:
    theirs = Fraction(known.constant, gcd(*known.factors))
    ours = Fraction(row.constant, divisor)
    return ours > theirs or (ours == theirs and row.relation == "<" != known.relation)


def _holds(value: int, relation: str) -> bool:
    return value == 0 if relation == "==" else value < 0 or (value == 0 and relation == "<=")


def _eliminate(rows: Sequence[Row], column: int) -> list[Row]:
    """Return rows that hold where some value of a column makes all hold (Fourier and Motzkin)."""
    anchor = next((r for r in rows if r.relation == "==" and r.factors[column]), None)
    if anchor is not None:
        return _tidy(_combined(row, anchor, column) if row.factors[column] else row
                     for row in rows if row is not anchor)
    above = [r for r in rows if r.factors[column] > 0]
    below = [r for r in rows if r.factors[column] < 0]
    rest = [r for r in rows if r.factors[column] == 0]
    if len(above) * len(below) + len(rest) > ROW_LIMIT:
        raise LimitError(f"a polyhedron has over {ROW_LIMIT} rows")
    return _needed(_tidy([*rest, *(_combined(a, b, column) for a in above for b in below)]))


def _combined(row: Row, other: Row, column: int) -> Row:
    """Return the sum of multiples of two rows in which a column vanishes.

    The multiple of an inequality is positive; `other` may be an equation, whose multiple may not.
    """
    a, b = row.factors[column], other.factors[column]
    mine, theirs = (b, -a) if b > 0 else (-b, a)
    factors = tuple(mine * x + theirs * y for x, y in zip(row.factors, other.factors, strict=True))
    strict = "<" in (row.relation, other.relation)
    relation = "==" if row.relation == other.relation == "==" else "<" if strict else "<="
    return Row(factors, mine * row.constant + theirs * other.constant, relation)


def _solvable(rows: Iterable[Row]) -> bool:
    """Whether some point satisfies all rows."""
    inequalities: list[Inequality] = []
    for row in rows:
        inequalities.append((row.factors, row.constant, row.relation == "<"))
        if row.relation == "==":
            inequalities.append((tuple(-f for f in row.factors), -row.constant, False))
    return is_feasible(inequalities)


def _needed(rows: Sequence[Row]) -> list[Row]:
    """Leave out the rows that the others imply."""
    kept = list(rows)
    for row in rows:
        if row.relation != "==" and len(kept) > 2:
            others = [r for r in kept if r is not row]
            if not any(_solvable([*others, opposite]) for opposite in _opposites(row)):
                kept = others
    return kept
