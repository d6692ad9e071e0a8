"""Robustness: how far a run stayed from violating a numeric formula.

The quantitative reading of signal temporal logic (Donzé and Maler, 2010): the distance of a
comparison is the difference of its sides, of `&` the smaller, of `|` the larger one, of G the
smallest and of F the largest that ever was. A tag that is a truth value is infinitely far from
being the other. It is told of G p and F p where p speaks of one instant and compares numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from plcemu.monitor.bind import NUMBER, Binder, Values, Writer
from plcemu.monitor.formula import (
    OPERATORS,
    Binary,
    Formula,
    Kind,
    Unary,
    children,
    is_state,
    walk,
)


class Margin:
    """Keeps the distance of G p (the smallest so far) or F p (the largest so far)."""

    def __init__(self, distance: Callable[[Values, Values], float], always: bool,
                 tags: Sequence[int]) -> None:
        self._distance, self._always, self._tags = distance, always, tags
        self._extreme = math.inf if always else -math.inf

    @property
    def value(self) -> float | None:
        """The robustness, in the unit of the compared values; None where none was measured."""
        return self._extreme if math.isfinite(self._extreme) else None

    def step(self, now: Values, before: Values, sure: bool) -> None:
        """Take the values from an instant on; values that are not known measure nothing."""
        if not sure:
            if any(now[i] is None for i in self._tags):
                return
            before = now
        distance = self._distance(now, before)
        if (distance < self._extreme) is self._always:
            self._extreme = distance


def margin_of(formula: Formula, binder: Binder) -> Margin | None:
    """Return what measures a formula's robustness; None if it is not of this kind."""
    if not isinstance(formula, Unary) or formula.op not in ("G", "F") or formula.interval \
            or not is_state(formula.arg) or not _is_numeric(formula.arg, binder):
        return None
    writer = Writer(binder)
    code = compile(f"lambda now, before: {_distance(formula.arg, writer)}",
                   f"<distance of {formula.arg}>", "eval")
    return Margin(eval(code, writer.scope), formula.op == "G", binder.used(formula))


def _compares(formula: Formula, binder: Binder) -> bool:
    return isinstance(formula, Binary) and OPERATORS[formula.op].kind is Kind.COMPARISON \
        and binder.kind(formula.left) == binder.kind(formula.right) == NUMBER


def _is_numeric(formula: Formula, binder: Binder) -> bool:
    return any(_compares(part, binder) for part in walk(formula))


_DISTANCE = {"=": "-abs({0} - {1})", "!=": "abs({0} - {1})", "<": "({1} - {0})",
             "<=": "({1} - {0})", ">": "({0} - {1})", ">=": "({0} - {1})",
             "!": "(-{0})", "&": "min({0}, {1})", "|": "max({0}, {1})", "->": "max(-{0}, {1})",
             "<->": "min(max(-{0}, {1}), max({0}, -{1}))"}


def _distance(formula: Formula, writer: Writer) -> str:
    """Write the distance of a state formula from being false as a Python expression."""
    if isinstance(formula, Binary) and _compares(formula, writer.binder):
        parts = [writer.quick(part, "now") for part in children(formula)]
    elif isinstance(formula, (Unary, Binary)) and OPERATORS[formula.op].kind is Kind.LOGIC:
        parts = [_distance(part, writer) for part in children(formula)]
    else:
        return f"(inf if {writer.quick(formula, 'now')} else -inf)"
    return _DISTANCE[formula.op].format(*parts)
