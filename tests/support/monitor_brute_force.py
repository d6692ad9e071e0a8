"""A slow, plain reading of the property language on whole ns, for comparison with the monitor.

Written from the definitions alone: quantifiers over instants, three values, no signals, no
incremental work. A run is a list of rows, one for each instant from 0; each row maps tags to
values. `Brute(run, known)` has seen the instants 0 .. known, what comes later is unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache

from plcemu.monitor.formula import Binary, Duration, Formula, Interval, Literal, TagRef, Unary

Row = dict[str, bool | int | float | str]
Three = bool | None
"""True, False, or None for unknown."""


def some(values: Iterable[Three]) -> Three:
    """Return Kleene's disjunction."""
    seen = list(values)
    return True if True in seen else (None if None in seen else False)


def every(values: Iterable[Three]) -> Three:
    """Return Kleene's conjunction."""
    return negated(some(negated(v) for v in values))


def negated(value: Three) -> Three:
    """Return Kleene's negation."""
    return None if value is None else not value


def reach(formula: Formula) -> int:
    """Return a bound of how far apart an instant and its causes can be."""
    if isinstance(formula, (Unary, Binary)):
        interval = formula.interval or Interval()
        own = max(interval.low_ns, interval.high_ns or 0) + 2
        parts = (formula.arg,) if isinstance(formula, Unary) else (formula.left, formula.right)
        return own + sum(reach(part) for part in parts)
    return 1


class Brute:
    """The value of formulas once the instants 0 .. known of a run have been seen."""

    def __init__(self, run: list[Row], known: int, horizon: int) -> None:
        self.run, self.known, self.horizon = run, known, horizon
        self.three = lru_cache(maxsize=None)(self._three)
        self.finite = lru_cache(maxsize=None)(self._finite)

    def number(self, formula: Formula, t: int) -> bool | int | float | str:
        """Return the value of a timeless part."""
        if isinstance(formula, TagRef):
            return self.run[t][formula.name]
        if isinstance(formula, Literal):
            return formula.value
        if isinstance(formula, Duration):
            return formula.ns
        if isinstance(formula, Unary):
            return -self.number(formula.arg, t)
        return _VALUES[formula.op](self.number(formula.left, t), self.number(formula.right, t))

    def _three(self, formula: Formula, t: int) -> Three:
        """Return the value at an instant in three values."""
        if isinstance(formula, Literal):
            return bool(formula.value)
        if is_leaf(formula):
            return bool(self.number(formula, t)) if t <= self.known else None
        if isinstance(formula, Unary) and formula.op in _PULSES:
            return self.pulse(formula, t) if t <= self.known else None
        return self.temporal(formula, t, self.three, self.horizon)

    def _finite(self, formula: Formula, t: int) -> bool:
        """Return the value if the run ended at the last known instant."""
        value = self.three(formula, t)
        if value is None:
            value = self.temporal(in_two_demands(formula), t, self.finite, self.known)
        assert value is not None
        return value

    def pulse(self, formula: Unary, t: int) -> bool:
        """Return rise, fall or changed, by the instant before."""
        if t == 0:
            return False
        now, before = (self.state(formula.arg, u) for u in (t, t - 1))
        return {"rise": bool(now and not before), "fall": bool(before and not now),
                "changed": now != before}[formula.op]

    def state(self, formula: Formula, t: int) -> bool | int | float | str | None:
        return self.number(formula, t) if is_leaf(formula) else self.three(formula, t)

    def temporal(self, f: Formula, t: int, at: Callable[[Formula, int], Three], last: int) -> Three:
        """Return the value of a connective or a temporal operator, by its definition.

        Up to the horizon all is told; there nothing moves any more, so that the last value stands
        for all later ones. A finite reading looks at no instant after `last`.
        """
        assert isinstance(f, (Unary, Binary))
        first, end = offsets(f, last - t)
        end = min(end, last - t) if last == self.known else end
        ahead = range(t + first, t + end + 1)
        first, end = offsets(f, t)
        behind = range(max(0, t - end), t - first + 1)

        def value(part: Formula, u: int) -> Three:
            return at(part, min(u, last))

        if isinstance(f, Unary):
            return {
                "!": lambda: negated(value(f.arg, t)),
                "F": lambda: some(value(f.arg, u) for u in ahead),
                "G": lambda: every(value(f.arg, u) for u in ahead),
                "O": lambda: some(value(f.arg, u) for u in behind),
                "H": lambda: every(value(f.arg, u) for u in behind),
                "Y": lambda: value(f.arg, t - 1) if t > 0 else False,
            }[f.op]()

        def left(u: int) -> Three:
            return value(f.left, u)

        def right(u: int) -> Three:
            return value(f.right, u)

        def reached(u: int) -> Three:
            return every([right(u), *(left(k) for k in range(t, u))])

        def released(u: int) -> Three:
            return some([right(u), *(left(k) for k in range(t, u))])

        def lasting(u: int) -> Three:
            return every([right(u), *(left(k) for k in range(u + 1, t + 1))])

        return {
            "&": lambda: every([left(t), right(t)]),
            "|": lambda: some([left(t), right(t)]),
            "->": lambda: some([negated(left(t)), right(t)]),
            "<->": lambda: every([some([negated(left(t)), right(t)]),
                                  some([negated(right(t)), left(t)])]),
            "U": lambda: some(reached(u) for u in ahead),
            "W": lambda: some([*(reached(u) for u in ahead),
                               every(left(u) for u in range(t, ahead.stop))]),
            "R": lambda: every(released(u) for u in ahead),
            "S": lambda: some(lasting(u) for u in behind),
        }[f.op]()


def in_two_demands(f: Formula) -> Formula:
    """Return p U[a,b] q as G[0,a) p and, a later, p U[0,b-a] q; so for W and R.

    At a cut the first demand may still be open while the second is settled already.
    """
    late = isinstance(f, Binary) and f.op in ("U", "W", "R") and offsets(f, 0)[0] > 0
    return _TWO_DEMANDS[f.op](f) if late and isinstance(f, Binary) else f


def _two_demands(f: Binary) -> Formula:
    first = offsets(f, 0)[0]
    high = f.interval and f.interval.high_ns
    rest = None if high is None else Interval(0, offsets(f, 0)[1] - first, True, True)
    before, then = Interval(0, first, True, False), Interval(first, first, True, True)
    return Binary("&", Unary("G", f.left, before),
                  Unary("F", Binary("U", f.left, f.right, rest), then))


def _weak(f: Binary) -> Formula:
    whole = None if f.interval is None or f.interval.high_ns is None else Interval(
        0, offsets(f, 0)[1], True, True)
    return Binary("|", Binary("U", f.left, f.right, f.interval), Unary("G", f.left, whole))


def _dual(f: Binary) -> Formula:
    return Unary("!", Binary("U", Unary("!", f.left), Unary("!", f.right), f.interval))


_TWO_DEMANDS: dict[str, Callable[[Binary], Formula]] = {
    "U": _two_demands, "W": _weak, "R": _dual}


def is_leaf(formula: Formula) -> bool:
    """Tell whether a part is a tag, a literal or a comparison."""
    return (isinstance(formula, (TagRef, Literal, Duration))
            or (isinstance(formula, Binary) and formula.op in _VALUES))


def offsets(formula: Unary | Binary, rest: int) -> tuple[int, int]:
    """Return the least and the greatest distance that the operator looks at; `rest` is all."""
    interval = formula.interval or Interval()
    first = interval.low_ns + (0 if interval.low_closed else 1)
    if interval.high_ns is None:
        return first, max(rest, first) + 1
    return first, interval.high_ns - (0 if interval.high_closed else 1)


_PULSES = ("rise", "fall", "changed")
_VALUES: dict[str, Callable[..., bool | int | float]] = {
    "=": lambda a, b: a == b, "!=": lambda a, b: a != b, "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b, ">": lambda a, b: a > b, ">=": lambda a, b: a >= b,
    "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b,
    "/": lambda a, b: a / b}


def verdict_at(formula: Formula, run: list[Row], known: int) -> Three:
    """Return the verdict once 0 .. known have been seen."""
    return Brute(run, known, known + reach(formula)).three(formula, 0)


def decided_at(formula: Formula, run: list[Row]) -> tuple[int, bool] | None:
    """Return the first instant at which a run decides a formula, and how; None if it does not."""
    verdicts = ((t, verdict_at(formula, run, t)) for t in range(len(run)))
    return next(((t, v) for t, v in verdicts if v is not None), None)


def presumed(formula: Formula, run: list[Row]) -> bool:
    """Return the value if the run ended with its last instant."""
    known = len(run) - 1
    return Brute(run, known, known + reach(formula)).finite(formula, 0)
