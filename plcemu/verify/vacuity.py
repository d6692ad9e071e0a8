"""Vacuity: parts of a property that holds which could as well not be there.

A part that stands where the property gains from it is replaced by FALSE, one that stands where the
property loses by it, by TRUE; if the property still holds, it does not depend on the part (Beer,
Ben-David, Eisner, Rodeh, 2001; Kupferman and Vardi, 2003). If that is the conclusion of an
implication, its premise is never true. What stands in premises is left alone: a condition that is
said more exactly than it had to be is no sign of a mistake.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Literal, NamedTuple

from plcemu.monitor.formula import (
    FALSE,
    OPERATORS,
    TRUE,
    Binary,
    Formula,
    Kind,
    Unary,
    children,
    rebuilt,
)
from plcemu.monitor.formula import Literal as Constant

_BOTH_WAYS = ("<->", "xor")
_IMPLIES = ("->", "-->")
_VALUES = (Kind.COMPARISON, Kind.ARITHMETIC, Kind.PULSE, Kind.EARLIER)

When = Literal["first", "always", "sometimes"]
"""Instants: the first one of a run, all of them, some."""

Within = Callable[[Formula], Formula]
"""Puts a formula in a part's place in the whole."""


class Part(NamedTuple):
    """A part of a property.

    Attributes:
        stronger: the property with TRUE or FALSE for the part.
        meaning: what it means, in words, if that holds as well.
        inner: returns its own parts.
    """

    stronger: Formula
    meaning: str
    inner: Callable[[], Iterator[Part]]


def idle_parts(formula: Formula, holds: Callable[[Formula], bool]) -> tuple[str, ...]:
    """Return, in words, the parts that a property which holds does not depend on.

    Args:
        formula: the property.
        holds: tells whether a stronger property, with TRUE or FALSE for a part, holds as well.
    """
    def idle(parts: Iterator[Part]) -> Iterator[str]:
        for part in parts:
            if holds(part.stronger):
                yield part.meaning
            else:
                yield from idle(part.inner())

    return tuple(dict.fromkeys(idle(parts_of(formula, demanded="first"))))


def parts_of(formula: Formula, within: Within = lambda part: part, *, gains: bool = True,
             demanded: When = "sometimes") -> Iterator[Part]:
    """Yield the parts of a formula that stands in a property.

    Args:
        formula: whose parts.
        within: puts another one in its place in the property.
        gains: whether the property gains from it, or loses by it.
        demanded: when it must hold.
    """
    if not isinstance(formula, (Unary, Binary)) or formula.op in _BOTH_WAYS \
            or OPERATORS[formula.op].kind in _VALUES:
        return
    implies = formula.op in _IMPLIES
    never = gains and (demanded == "always" or (demanded == "first" and formula.op == "-->"))
    parts = children(formula)
    for n, part in enumerate(parts):
        if isinstance(part, Constant) or (implies and n == 0):
            continue

        def put(new: Formula, n: int = n) -> Formula:
            return within(rebuilt(formula, [*parts[:n], new, *parts[n + 1:]]))

        part_gains = gains != (formula.op == "!")
        yield Part(put(FALSE if part_gains else TRUE),
                   f"{parts[0]} is never true" if implies and never
                   else f"it holds whatever {part} is",
                   partial(parts_of, part, put, gains=part_gains,
                           demanded=_demanded(formula.op, demanded)))


def _demanded(op: str, whole: When) -> When:
    """Return when a part must hold if the whole, made with an operator, must hold then."""
    if op == "&":
        return whole
    return "always" if op in ("G", "AG") and whole != "sometimes" else "sometimes"
