"""Vacuity: parts of a property that holds which could as well not be there.

A part that stands where the property gains from it is replaced by FALSE, one that stands where the
property loses by it, by TRUE; if the property still holds, it does not depend on the part (Beer,
Ben-David, Eisner, Rodeh, 2001; Kupferman and Vardi, 2003). If that is the conclusion of an
implication, its premise is never true. What stands in premises is left alone: a condition that is
said more exactly than it had to be is no sign of a mistake.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from plcemu.monitor.formula import (
    FALSE,
    OPERATORS,
    TRUE,
    Binary,
    Formula,
    Kind,
    Literal,
    Unary,
    children,
    rebuilt,
)

_BOTH_WAYS = ("<->", "xor")
_VALUES = (Kind.COMPARISON, Kind.ARITHMETIC, Kind.PULSE, Kind.EARLIER)


def idle_parts(formula: Formula, holds: Callable[[Formula], bool]) -> tuple[str, ...]:
    """Return, in words, the parts that a property which holds does not depend on.

    Args:
        formula: the property.
        holds: tells whether a stronger property, with TRUE or FALSE for a part, holds as well.
    """
    return tuple(dict.fromkeys(_idle(formula, formula, lambda part: part, True, holds)))


def _idle(whole: Formula, part: Formula, into: Callable[[Formula], Formula], gains: bool,
          holds: Callable[[Formula], bool]) -> Iterator[str]:
    """Yield what is idle in a part; `into` puts something in its place in the whole."""
    if isinstance(part, Literal) or not isinstance(part, (Unary, Binary)) \
            or part.op in _BOTH_WAYS or OPERATORS[part.op].kind in _VALUES:
        return
    parts = children(part)
    for n, child in enumerate(parts):
        def put(new: Formula, n: int = n) -> Formula:
            return into(rebuilt(part, [*parts[:n], new, *parts[n + 1:]]))

        premise = part.op in ("->", "-->") and n == 0
        child_gains = gains != (part.op == "!" or premise)
        if isinstance(child, Literal) or premise:
            continue
        if holds(put(FALSE if child_gains else TRUE)):
            yield f"{parts[0]} is never true" if part.op in ("->", "-->") and gains else \
                f"it holds whatever {child} is"
        else:
            yield from _idle(whole, child, put, child_gains, holds)
