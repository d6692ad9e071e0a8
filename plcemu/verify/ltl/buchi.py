"""Linear temporal logic as a Büchi automaton, made while it runs.

A state of the automaton is a set of formulas that the rest of the run must satisfy. A step reads
which leaves are true now, and says in which ways the rest can: `p U q` becomes q, or p and again
`p U q`; `p R q` becomes q with p, or q and again `p R q`. An until that is put off in a step is
noted with it. A run is accepted if it goes on for ever and puts no until off from some step on: a
generalised Büchi condition on steps (Gerth, Peled, Vardi, Wolper, 1995; Couvreur, 1999).

If nothing is left to be satisfied, whatever follows, the beginning was enough: the empty state.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class Tree:
    """A formula in negation normal form.

    Attributes:
        op: `leaf`, `not` (of a leaf), `&`, `|`, `X`, `U`, `R`, `TRUE` or `FALSE`.
        args: its operands.
        leaf: the leaf's number.
    """

    op: str
    args: tuple[Tree, ...] = ()
    leaf: int = 0

    def __str__(self) -> str:
        if self.op in ("leaf", "not"):
            return f"{'!' * (self.op == 'not')}{self.leaf}"
        return f"({f' {self.op} '.join(map(str, self.args))})" if len(self.args) > 1 else \
            f"{self.op} {self.args[0]}" if self.args else self.op


TOP, BOTTOM = Tree("TRUE"), Tree("FALSE")


def leaf(number: int, positive: bool = True) -> Tree:
    """A leaf, or its negation."""
    return Tree("leaf" if positive else "not", (), number)


def both(p: Tree, q: Tree) -> Tree:
    """p & q."""
    if BOTTOM in (p, q):
        return BOTTOM
    return q if p == TOP else p if q == TOP else Tree("&", (p, q))


def either(p: Tree, q: Tree) -> Tree:
    """p | q."""
    if TOP in (p, q):
        return TOP
    return q if p == BOTTOM else p if q == BOTTOM else Tree("|", (p, q))


def following(p: Tree) -> Tree:
    """X p."""
    return p if p in (TOP, BOTTOM) else Tree("X", (p,))


def until(p: Tree, q: Tree) -> Tree:
    """p U q."""
    return q if q in (TOP, BOTTOM) or p == BOTTOM else Tree("U", (p, q))


def release(p: Tree, q: Tree) -> Tree:
    """p R q."""
    return q if q in (TOP, BOTTOM) or p == TOP else Tree("R", (p, q))


class Way(NamedTuple):
    """A way to satisfy something now: what is left for the rest, and the untils put off."""

    left: frozenset[Tree]
    put_off: frozenset[Tree]


class Move(NamedTuple):
    """A step of the automaton: the state after it, and the untils put off, a bit for each."""

    after: int
    put_off: int


_DONE = Way(frozenset(), frozenset())
SATISFIED = 0
"""The state in which nothing is left to be satisfied."""


class Automaton:
    """The automaton of a formula; its states are numbered as they are met.

    Attributes:
        initial: the first state.
        untils: how many untils there are; each must not be put off for ever.
    """

    def __init__(self, formula: Tree) -> None:
        self._states: list[frozenset[Tree]] = [frozenset()]
        self._numbers: dict[frozenset[Tree], int] = {frozenset(): SATISFIED}
        self._untils = {u: n for n, u in enumerate(dict.fromkeys(_untils(formula)))}
        self._moves: dict[tuple[int, int], tuple[Move, ...]] = {}
        self._ways: dict[tuple[Tree, int], tuple[Way, ...]] = {}
        self.untils = len(self._untils)
        self.initial = self._state(frozenset() if formula == TOP else frozenset([formula]))

    def moves(self, state: int, true: int) -> tuple[Move, ...]:
        """Return the steps from a state where the leaves whose bits are set are true."""
        key = state, true
        found = self._moves.get(key)
        if found is None:
            ways = _least(_merged(ways) for ways in
                          product(*[self._now(f, true) for f in self._states[state]]))
            found = self._moves[key] = tuple(
                Move(self._state(way.left), sum(1 << self._untils[u] for u in way.put_off))
                for way in ways)
        return found

    def _state(self, duties: frozenset[Tree]) -> int:
        number = self._numbers.setdefault(duties, len(self._states))
        if number == len(self._states):
            self._states.append(duties)
        return number

    def _now(self, f: Tree, true: int) -> tuple[Way, ...]:
        """Return the ways to satisfy a formula."""
        key = f, true
        found = self._ways.get(key)
        if found is None:
            found = self._ways[key] = tuple(_least(self._possible(f, true)))
        return found

    def _possible(self, f: Tree, true: int) -> Iterator[Way]:
        if f.op in ("leaf", "not"):
            yield from [_DONE] if (true >> f.leaf & 1) == (f.op == "leaf") else []
        elif f.op == "TRUE":
            yield _DONE
        elif f.op == "X":
            yield Way(frozenset(f.args), frozenset())
        elif f.op == "|":
            yield from self._now(f.args[0], true)
            yield from self._now(f.args[1], true)
        elif f.op == "&":
            yield from map(_merged, product(self._now(f.args[0], true),
                                            self._now(f.args[1], true)))
        elif f.op == "U":
            yield from self._now(f.args[1], true)
            again = Way(frozenset([f]), frozenset([f]))
            yield from (_merged((way, again)) for way in self._now(f.args[0], true))
        elif f.op == "R":
            again = Way(frozenset([f]), frozenset())
            yield from map(_merged, product(self._now(f.args[1], true),
                                            [*self._now(f.args[0], true), again]))


def _merged(ways: tuple[Way, ...]) -> Way:
    return Way(frozenset().union(*(w.left for w in ways)),
               frozenset().union(*(w.put_off for w in ways)))


def _least(ways: Iterator[Way]) -> list[Way]:
    """Return the ways of which no other one leaves less and puts off less."""
    every = sorted(dict.fromkeys(ways), key=lambda way: len(way.left) + len(way.put_off))
    found: list[Way] = []
    for way in every:
        if not any(w.left <= way.left and w.put_off <= way.put_off for w in found):
            found.append(way)
    return found


def _untils(formula: Tree) -> Iterator[Tree]:
    if formula.op == "U":
        yield formula
    for part in formula.args:
        yield from _untils(part)
