"""Which kind of region an automaton needs: zones where all are clocks, else polyhedra."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from math import gcd, lcm
from typing import Protocol, Self

from plant_sim.linear import Constraint, Constraints, Term
from plant_sim.linear_automaton import Automaton, Interval
from plcemu.verify.hybrid.polyhedra import Bounds, Polyhedron
from plcemu.verify.hybrid.zones import NotAZone, Scale, Zone, difference

VARIABLE_LIMIT = 8
"""Variables of an automaton; the cost of exact polyhedra grows steeply with them."""


class Region(Protocol):
    """A convex set of values of the variables."""

    def meet(self, constraints: Constraints) -> Self:
        """Return the points at which constraints hold."""

    def forget(self, names: Iterable[str]) -> Self:
        """Let variables be anything."""

    def assign(self, sets: Mapping[str, Interval]) -> Self:
        """Set variables to any value of an interval."""

    def elapse(self, rates: Mapping[str, Interval]) -> Self:
        """Let any time pass."""

    def is_empty(self) -> bool:
        """Whether there is no point."""

    def covers(self, other: Self) -> bool:
        """Whether every point of another region is one of this."""

    def weight(self) -> tuple[int, int]:
        """Return what is no smaller for a region that covers another."""

    def ratio(self, above: Term, below: Term) -> Bounds:
        """Return the bounds of a ratio."""


Maker = Callable[[Constraints], Region]
"""Makes the region in which constraints hold."""

KINDS = ("auto", "zones", "polyhedra")
"""How regions may be kept; `auto` takes zones where they are exact."""


def region_maker(automaton: Automaton, kind: str = "auto") -> tuple[str, Maker]:
    """Return the kind of region for an automaton, and what makes regions.

    Raises:
        ValueError: an unknown kind; too many variables; zones asked for where they do not fit.
    """
    if kind not in KINDS:
        raise ValueError(f"there is no kind of region {kind!r}; choose one of {', '.join(KINDS)}")
    if len(automaton.variables) > VARIABLE_LIMIT:
        raise ValueError(f"the automaton has {len(automaton.variables)} variables; at most "
                         f"{VARIABLE_LIMIT} can be treated")
    if kind != "polyhedra":
        try:
            scale = _scale(automaton)
        except NotAZone as reason:
            if kind == "zones":
                raise ValueError(f"zones do not fit: {reason}") from None
        else:
            return "zones", lambda constraints: Zone.of(scale, constraints)
    names = automaton.variables
    return "polyhedra", lambda constraints: Polyhedron.of(names, constraints)


def _scale(automaton: Automaton) -> Scale:
    one = (Fraction(1), Fraction(1))
    for place in automaton.locations:
        for name, rate in place.rates.items():
            if rate != one:
                raise NotAZone(f"{name} is no clock in {place.name}")
    values = [difference(c)[2] for c in _constraints(automaton) if c.term.factors]
    values += [v for t in automaton.transitions for pair in t.sets.values() for v in pair]
    below = lcm(1, *(v.denominator for v in values))
    above = gcd(0, *(int(v * below) for v in values)) or 1
    return Scale(automaton.variables, Fraction(above, below))


def _constraints(automaton: Automaton) -> list[Constraint]:
    return [*automaton.start,
            *(c for place in automaton.locations
              for part in (place.invariant, *(r.where for r in place.readings)) for c in part),
            *(c for t in automaton.transitions for c in t.guard)]
