"""Jitter: releases whose distance varies from one to the next, as the cycle of a real PLC does.

The deviations add up: cycle k begins where cycle k - 1 ended, as in a PLC that times each cycle
from its own beginning. Every deviation is drawn by the seed, so a run can be repeated.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from fractions import Fraction
from random import Random

_BITS = 53
_WHOLE = (1 << _BITS) - 1


@dataclass(frozen=True, slots=True)
class Jitter:
    """How the duration of cycles varies.

    Attributes:
        deviation: largest, to either side, as a part of the interval; at least 0, below 1.
        per_run: whether one deviation is drawn for all cycles of a run, as of a clock that is fast
            or slow; else each cycle has its own.
        seed: of the draws.
    """

    deviation: Fraction
    per_run: bool = False
    seed: int = 0


class JitteredReleases:
    """The instants start, start + d1, start + d1 + d2, ... with durations d within the jitter.

    Args:
        start: the first instant, ns.
        step: the interval without jitter, ns.
        jitter: how it varies.
        name: of the task; tasks of one resource draw numbers of their own.
    """

    def __init__(self, start: int, step: int, jitter: Jitter, name: str) -> None:
        self._times = [start]
        self._step = step
        self._spread = step * jitter.deviation.numerator, _WHOLE * jitter.deviation.denominator
        self._random = Random(f"{jitter.seed}/{name.casefold()}")
        self._fixed = self._draw() if jitter.per_run else 0

    def _draw(self) -> int:
        """Return a duration, evenly distributed over the whole ns within the jitter, at least 1."""
        top, bottom = self._spread
        shift = top * (2 * self._random.getrandbits(_BITS) - _WHOLE)
        return max(1, self._step + (2 * shift + bottom) // (2 * bottom))

    def _reach(self, t_ns: int) -> None:
        times = self._times
        while times[-1] < t_ns:
            times.append(times[-1] + (self._fixed or self._draw()))

    def is_due(self, t_ns: int) -> bool:
        """Whether an instant is one of them."""
        return self.first(t_ns) == t_ns

    def first(self, not_before_ns: int) -> int:
        """Return the first one not before an instant."""
        self._reach(not_before_ns)
        return self._times[bisect_left(self._times, not_before_ns)]

    def last(self, before_ns: int) -> int:
        """Return the last one before an instant; -1 if there is none."""
        self._reach(before_ns)
        at = bisect_left(self._times, before_ns)
        return self._times[at - 1] if at else -1

    def count(self, first_ns: int, before_ns: int) -> int:
        """Return how many lie in [first, before)."""
        self._reach(before_ns)
        return max(0, bisect_left(self._times, before_ns) - bisect_left(self._times, first_ns))

    def within(self, first_ns: int, before_ns: int) -> list[int]:
        """Return those in [first, before)."""
        self._reach(before_ns)
        return self._times[bisect_left(self._times, first_ns):bisect_left(self._times, before_ns)]
