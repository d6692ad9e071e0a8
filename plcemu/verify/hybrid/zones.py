"""Zones: regions of clocks, which all run at rate 1, bounded by differences; the quick regions.

A matrix holds for each pair of clocks an upper bound of their difference; clock 0 is always zero
(Dill, 1989; Bengtsson and Yi, Timed Automata: Semantics, Algorithms and Tools, 2004). Bounds are
whole numbers of a unit in which every constant is whole, so nothing is rounded and nothing
overflows. A bound is kept as 2·value + 1, or 2·value where the value itself is excluded.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from operator import ge
from typing import Self

from plant_sim.linear import Constraint, Constraints, Term
from plant_sim.linear_automaton import Interval
from plcemu.verify.hybrid.polyhedra import Bounds, Polyhedron

Bound = tuple[int, int, int]
"""First clock, second clock, encoded bound of their difference."""

_ZERO = 1
"""The encoded bound `<= 0`."""


class NotAZone(ValueError):
    """A constraint that is no bound of a clock or of the difference of two."""


@dataclass(slots=True)
class Scale:
    """The clocks of a family of zones, and how their bounds are written.

    Attributes:
        names: of the clocks; clock k + 1 of the matrix is names[k].
        unit: of which every constant is a whole multiple.
    """

    names: tuple[str, ...]
    unit: Fraction
    _bounds: dict[int, tuple[Constraints, list[Bound]]] = field(default_factory=dict)
    _sets: dict[int, tuple[Mapping[str, Interval], list[Bound]]] = field(default_factory=dict)
    # Both are keyed by identity, for speed; what they hold keeps the identity taken.

    def bounds(self, constraints: Constraints) -> list[Bound]:
        """Return constraints as bounds.

        Raises:
            NotAZone: one of them is none.
        """
        known = self._bounds.get(id(constraints))
        if known is None:
            known = constraints, [b for c in constraints for b in self._of(c)]
            self._bounds[id(constraints)] = known
        return known[1]

    def sets(self, sets: Mapping[str, Interval]) -> list[Bound]:
        """Return for each clock that is set its number, its upper and its negated lower bound."""
        known = self._sets.get(id(sets))
        if known is None:
            known = sets, [(self.names.index(name) + 1, 2 * self.whole(high) + 1,
                            -2 * self.whole(low) + 1) for name, (low, high) in sets.items()]
            self._sets[id(sets)] = known
        return known[1]

    def _of(self, constraint: Constraint) -> list[Bound]:
        first, second, limit = difference(constraint)
        whole = self.whole(limit)
        i, j = (self.names.index(n) + 1 if n else 0 for n in (first, second))
        found = [(i, j, 2 * whole + (constraint.relation != "<"))]
        if constraint.relation == "==":
            found.append((j, i, -2 * whole + 1))
        return found

    def whole(self, value: Fraction) -> int:
        """Return a number in units; raises `NotAZone`."""
        units = value / self.unit
        if units.denominator != 1:
            raise NotAZone(f"{value} is no whole multiple of {self.unit}")
        return int(units)


def difference(constraint: Constraint) -> tuple[str, str, Fraction]:
    """Return (x, y, b) of a constraint `x - y <= b` (or <, ==), names empty for zero.

    Raises:
        NotAZone: it has another form.
    """
    factors = constraint.term.factors
    size = abs(factors[0][1]) if factors else Fraction(1)
    if len(factors) > 2 or any(abs(f) != size for _, f in factors) \
            or (len(factors) == 2 and factors[0][1] == factors[1][1]) or not factors:
        raise NotAZone("expected a bound of a clock or of the difference of two")
    up = next((n for n, f in factors if f > 0), "")
    down = next((n for n, f in factors if f < 0), "")
    return up, down, -constraint.term.constant / size


class Zone:
    """A set of clock values; a contradiction is the zone without a matrix."""

    __slots__ = ("_flat", "matrix", "scale")

    def __init__(self, scale: Scale, matrix: list[list[int | None]] | None) -> None:
        self.scale = scale
        self.matrix = matrix
        self._flat: list[float] | None = None

    @classmethod
    def of(cls, scale: Scale, constraints: Constraints) -> Self:
        """Return the clock values, of any sign, at which all constraints hold."""
        size = len(scale.names) + 1
        free: list[list[int | None]] = [[_ZERO if i == j else None for j in range(size)]
                                        for i in range(size)]
        return cls(scale, free).meet(constraints)

    def _copy(self) -> list[list[int | None]]:
        assert self.matrix is not None
        return [row[:] for row in self.matrix]

    def is_empty(self) -> bool:
        """Whether there is no point."""
        return self.matrix is None

    def meet(self, constraints: Constraints) -> Self:
        """Return the points of this zone at which constraints hold."""
        if self.matrix is None or not constraints:
            return self
        matrix = self.matrix
        for i, j, bound in self.scale.bounds(constraints):
            now, back = matrix[i][j], matrix[j][i]
            if now is not None and now <= bound:
                continue
            if back is not None and back + bound - ((back | bound) & 1) < _ZERO:
                return type(self)(self.scale, None)
            if matrix is self.matrix:
                matrix = self._copy()
            _tighten(matrix, i, j, bound)
        return self if matrix is self.matrix else type(self)(self.scale, matrix)

    def covers(self, other: Self) -> bool:
        """Whether every point of another zone is one of this."""
        if other.matrix is None:
            return True
        return self.matrix is not None and all(map(ge, self._limits(), other._limits()))

    def weight(self) -> tuple[int, int]:
        """Return the number of clocks without a bound, and the sum of the bounds."""
        if self.matrix is None:
            return -1, 0
        bounds = [row[0] for row in self.matrix]
        return bounds.count(None), sum(b for b in bounds if b is not None)

    def _limits(self) -> list[float]:
        """Return all bounds in a row, to be compared; made once."""
        if self._flat is None:
            assert self.matrix is not None
            self._flat = [math.inf if bound is None else bound
                          for row in self.matrix for bound in row]
        return self._flat

    def forget(self, names: Iterable[str]) -> Self:
        """Let clocks be anything."""
        if self.matrix is None:
            return self
        matrix = self._copy()
        for name in names:
            _release(matrix, self.scale.names.index(name) + 1)
        return type(self)(self.scale, matrix)

    def assign(self, sets: Mapping[str, Interval]) -> Self:
        """Set clocks to any value of an interval."""
        if self.matrix is None or not sets:
            return self
        matrix = self._copy()
        zero = matrix[0]
        for i, upper, lower in self.scale.sets(sets):
            _release(matrix, i)
            for j, row in enumerate(matrix):
                if j != i:
                    row[i] = _sum(row[0], lower)
                    matrix[i][j] = _sum(upper, zero[j])
        return type(self)(self.scale, matrix)

    def elapse(self, rates: Mapping[str, Interval]) -> Self:
        """Let any time pass; every clock runs at rate 1, so no upper bound remains."""
        if self.matrix is None:
            return self
        matrix = self._copy()
        for row in matrix[1:]:
            row[0] = None
        return type(self)(self.scale, matrix)

    def extrapolate(self, largest: Sequence[int]) -> Self:
        """Forget what is beyond the largest number of units that each clock is compared with.

        Finitely many zones remain, and no point is added that could not do the same as one that was
        there, if clocks are only compared with numbers (Bouyer, Forward analysis of updatable timed
        automata, 2004).
        """
        if self.matrix is None:
            return self
        tops = (0, *largest)
        changed, matrix = False, self._copy()
        for i, row in enumerate(matrix):
            for j, bound in enumerate(row):
                if bound is None or i == j:
                    continue
                if i and bound > 2 * tops[i] + 1:
                    row[j], changed = None, True
                elif bound < -2 * tops[j]:
                    row[j], changed = -2 * tops[j], True
        if not changed:
            return self
        _close(matrix)
        return type(self)(self.scale, matrix)

    def polyhedron(self) -> Polyhedron:
        """Return the same set as a polyhedron."""
        names = self.scale.names
        if self.matrix is None:
            return Polyhedron.of(names, [Constraint(Term((), Fraction(1)), "<=")])
        named = ("", *names)
        found = [Constraint(_difference(named[i], named[j], bound, self.scale.unit),
                            "<=" if bound & 1 else "<")
                 for i, row in enumerate(self.matrix) for j, bound in enumerate(row)
                 if i != j and bound is not None]
        return Polyhedron.of(names, found)

    def ratio(self, above: Term, below: Term) -> Bounds:
        """Return the bounds of `above / below`; see `Polyhedron.ratio`."""
        unused = [n for n in self.scale.names if n not in above.names | below.names]
        whole = self.forget(unused).polyhedron()
        kept = tuple(n for n in self.scale.names if n not in unused)
        places = [self.scale.names.index(n) for n in kept]
        rows = tuple(row._replace(factors=tuple(row.factors[i] for i in places))
                     for row in whole.rows)
        return Polyhedron(kept, rows).ratio(above, below)


def _difference(first: str, second: str, bound: int, unit: Fraction) -> Term:
    factors = {name: Fraction(sign) for name, sign in ((first, 1), (second, -1)) if name}
    return Term.of(factors, -(bound >> 1) * unit)


def _sum(a: int | None, b: int | None) -> int | None:
    """Return the sum of two bounds; it includes its value if both do."""
    return None if a is None or b is None else a + b - ((a | b) & 1)


def _close(matrix: list[list[int | None]]) -> None:
    """Make all bounds of a zone that is not empty as tight as the others make them."""
    for k, through in enumerate(matrix):
        for row in matrix:
            first = row[k]
            if first is None:
                continue
            for j, second in enumerate(through):
                if second is not None:
                    total = first + second - ((first | second) & 1)
                    known = row[j]
                    if known is None or total < known:
                        row[j] = total


def _release(matrix: list[list[int | None]], i: int) -> None:
    for j, row in enumerate(matrix):
        if j != i:
            row[i] = matrix[i][j] = None


def _tighten(matrix: list[list[int | None]], i: int, j: int, bound: int) -> None:
    """Add a bound that does not contradict, and make all others as tight as it makes them."""
    through = matrix[j]
    for row in matrix:
        first = row[i]
        if first is None:
            continue
        base = first + bound - ((first | bound) & 1)
        for k, second in enumerate(through):
            if second is not None:
                total = base + second - ((base | second) & 1)
                known = row[k]
                if known is None or total < known:
                    row[k] = total
