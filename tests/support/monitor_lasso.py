"""The property language on runs without an end: a beginning, and a loop that repeats for ever.

Written from the definitions alone, for comparison with the monitor: an instant of the endless run
is a place in the beginning or in one of so many unrolled loops that what the past operators say
has become periodic in the last one; after its end the last loop begins again.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

from monitor_brute_force import Brute, Row, is_leaf, offsets, reach

from plcemu.monitor.formula import Binary, Formula, Literal, Unary


class Lasso:
    """The truth of formulas on a beginning and a loop.

    Args:
        begin, loop: what holds at each instant.
        formula: the formula that will be asked about, or the largest of several.
        scans: the instants of the beginning and the first loop at which a scan is; X looks at the
            next one. The loop's first instant must be one of them.
    """

    def __init__(self, begin: list[Row], loop: list[Row], formula: Formula,
                 scans: Collection[int] = ()) -> None:
        rounds = reach(formula) // len(loop) + 4
        self.run = begin + loop * rounds
        self.period = len(loop)
        self.end = len(self.run)
        self.scans = {t for t in scans if t < len(begin)} | {
            t + self.period * k for k in range(rounds + 1) for t in scans if t >= len(begin)}
        self.states = Brute(self.run, self.end - 1, self.end)
        self.holds = lru_cache(maxsize=None)(self._holds)

    def place(self, t: int) -> int:
        """Return the place that an instant of the endless run is like."""
        return t if t < self.end else self.end - self.period + (t - self.end) % self.period

    def _holds(self, f: Formula, t: int) -> bool:
        if isinstance(f, Literal):
            return bool(f.value)
        if is_leaf(f):
            return bool(self.states.number(f, t))
        assert isinstance(f, (Unary, Binary))
        if f.op in ("rise", "fall", "changed"):
            assert isinstance(f, Unary)
            return bool(self.states.pulse(f, t))
        if f.op == "X":
            assert isinstance(f, Unary)
            return self.holds(f.arg, self.place(min(u for u in self.scans if u > t)))
        first, last = offsets(f, self.end + self.period)
        ahead = [self.place(t + k) for k in range(first, last + 1)]
        behind = [t - k for k in range(first, last + 1) if t - k >= 0]
        return bool(_UNARY[f.op](self, f, t, ahead, behind) if isinstance(f, Unary)
                    else self.binary(f, t, first, last))

    def binary(self, f: Binary, t: int, first: int, last: int) -> bool:
        """Return the value of an operator with two operands."""
        def left(k: int) -> bool:
            return self.holds(f.left, self.place(t + k))

        def right(k: int) -> bool:
            return self.holds(f.right, self.place(t + k))

        until = any(right(k) and all(left(i) for i in range(k)) for k in range(first, last + 1)) \
            if f.op in ("U", "W") else False
        return {
            "&": lambda: left(0) and right(0),
            "|": lambda: left(0) or right(0),
            "->": lambda: not left(0) or right(0),
            "<->": lambda: left(0) is right(0),
            "U": lambda: until,
            "W": lambda: until or all(left(k) for k in range(last + 1)),
            "R": lambda: all(right(k) or any(left(i) for i in range(k))
                             for k in range(first, last + 1)),
            "S": lambda: any(right(-k) and all(left(-i) for i in range(k))
                             for k in range(first, min(last, t) + 1)),
        }[f.op]()


_UNARY = {
    "!": lambda s, f, t, ahead, behind: not s.holds(f.arg, t),
    "F": lambda s, f, t, ahead, behind: any(s.holds(f.arg, u) for u in ahead),
    "G": lambda s, f, t, ahead, behind: all(s.holds(f.arg, u) for u in ahead),
    "O": lambda s, f, t, ahead, behind: any(s.holds(f.arg, u) for u in behind),
    "H": lambda s, f, t, ahead, behind: all(s.holds(f.arg, u) for u in behind),
    "Y": lambda s, f, t, ahead, behind: t > 0 and s.holds(f.arg, t - 1),
}
