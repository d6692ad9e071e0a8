"""Quantities without a closed form: integrated by an embedded Runge-Kutta pair, events to the ns.

The steps of a trajectory depend on its anchor alone, never on who looks when: they are made as far
as they are needed, and a value between two of them is one step of the same method from the one
before. The pair is that of Dormand and Prince, orders 5 and 4 (J. Comput. Appl. Math. 6, 1980,
table 2), with the error control of Hairer, Norsett and Wanner, Solving ODEs I, section II.4.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from plant_sim.curves import NS_PER_S, Curve, Number, Test, bisect_first
from plant_sim.lines import NEVER_NS

State = Mapping[str, Any]
Rate = Callable[[State], float]
Vector = tuple[float, ...]

RELATIVE, ABSOLUTE = 1e-10, 1e-12
"""Error that one step may have, of each quantity."""

STEPS = 16
"""Steps of one trajectory; at the end of the last the mode is entered anew."""

FIRST_STEP_S, SHORTEST_S, LONGEST_S = 1e-4, 1e-9, 1e5
"""The first step tried; the shortest, taken whatever its error; and the longest."""

_KNOWN_LIMIT = 1024
"""Points of a trajectory that are remembered: guards and sensors look at the same samples."""

_PARTS = 2
"""Places in each step at which a crossing is looked for, so that one and its return are seen."""

_C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
_A = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_E = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
"""Weights of the difference between the two orders."""


@dataclass(frozen=True, slots=True)
class Ode:
    """Any rate, in units per s, as a function of the whole state at one instant."""

    rate: Rate

    def curve(self, value: Any, t0_ns: int) -> Curve:
        """No curve by itself: a mode integrates its `Ode` quantities together."""
        raise TypeError("quantities with an Ode are integrated together, in a Trajectory")


class Trajectory:
    """Quantities integrated together from an anchor on.

    Args:
        rates: of each quantity, in units per s.
        start: their values at the anchor.
        others: the state's other quantities, as curves.
        t0_ns: the anchor.
    """

    def __init__(self, rates: Mapping[str, Rate], start: Mapping[str, float],
                 others: Mapping[str, Curve], t0_ns: int) -> None:
        self.t0_ns = t0_ns
        self.names = tuple(rates)
        self._rates = tuple(rates.values())
        self._others = others
        self._times = [0.0]
        self._points: list[Vector] = [tuple(float(start[n]) for n in self.names)]
        self._next_s = FIRST_STEP_S
        self._known: dict[int, Vector] = {}

    def ends_before(self, t_ns: int) -> int | None:
        """The last whole ns of the trajectory if it is before an instant, else None."""
        while self._end_ns() < t_ns:
            if not self._extend():
                return max(self._end_ns(), self.t0_ns + 1)
        return None

    def _end_ns(self) -> int:
        return self.t0_ns + math.floor(self._times[-1] * NS_PER_S)

    def at(self, t_ns: int) -> Vector:
        """The quantities at an instant; beyond the horizon as at it."""
        known = self._known.get(t_ns)
        if known is None:
            if len(self._known) >= _KNOWN_LIMIT:
                self._known.clear()
            known = self._known[t_ns] = self._at(t_ns)
        return known

    def _at(self, t_ns: int) -> Vector:
        s = (t_ns - self.t0_ns) / NS_PER_S
        while self._times[-1] < s and self._extend():
            pass
        n = min(bisect_right(self._times, s) - 1, len(self._times) - 1)
        rest = s - self._times[n]
        return self._step(n, rest)[0] if rest > 0 else self._points[n]

    def _extend(self) -> bool:
        """Make one more step; return whether there was one left."""
        if len(self._times) > STEPS:
            return False
        h = self._next_s
        while True:
            point, error = self._step(len(self._times) - 1, h)
            fine = error <= 1 or h <= SHORTEST_S
            factor = min(5.0, max(0.2, 0.9 * error ** -0.2)) if error > 0 else 5.0
            self._next_s = min(max(h * factor, SHORTEST_S), LONGEST_S)
            if fine:
                break
            h = self._next_s
        self._times.append(self._times[-1] + h)
        self._points.append(point)
        return True

    def _step(self, n: int, h: float) -> tuple[Vector, float]:
        """One step of length `h` in s from point `n`: the new point and its error, 1 allowed."""
        t, y = self._times[n], self._points[n]
        slopes: list[Vector] = []
        for c, row in zip(_C, _A, strict=True):
            at = _moved(y, h, row, slopes)
            slopes.append(self._slope(t + c * h, at))
        new = at  # the last stage stands at the new point
        worst = 0.0
        for i, (old, now) in enumerate(zip(y, new, strict=True)):
            off = h * sum(e * k[i] for e, k in zip(_E, slopes, strict=True))
            allowed = ABSOLUTE + RELATIVE * max(abs(old), abs(now))
            worst = max(worst, abs(off) / allowed)
        return new, worst

    def _slope(self, t_s: float, y: Vector) -> Vector:
        t_ns: Any = self.t0_ns + t_s * NS_PER_S
        state = {name: curve.at(t_ns) for name, curve in self._others.items()}
        state.update(zip(self.names, y, strict=True))
        return tuple(rate(state) for rate in self._rates)

    def samples(self, t_ns: int) -> Iterator[int]:
        """Instants after `t_ns`, close enough together that no crossing is missed."""
        n = 1
        while n < len(self._times) or self._extend():
            begin, end = self._times[n - 1], self._times[n]
            for part in range(1, _PARTS + 1):
                at_ns = self.t0_ns + math.floor(
                    (begin + (end - begin) * part / _PARTS) * NS_PER_S)
                if at_ns > t_ns:
                    yield at_ns
            n += 1


def _moved(y: Vector, h: float, row: Sequence[float], slopes: Sequence[Vector]) -> Vector:
    if not row:
        return y
    return tuple(v + h * sum(a * k[i] for a, k in zip(row, slopes, strict=True))
                 for i, v in enumerate(y))


class OdeCurve:
    """One quantity of a trajectory."""

    __slots__ = ("_n", "t0_ns", "trajectory", "value")

    def __init__(self, trajectory: Trajectory, name: str) -> None:
        self.trajectory, self.t0_ns = trajectory, trajectory.t0_ns
        self._n = trajectory.names.index(name)
        self.value = self.at(self.t0_ns)

    def at(self, t_ns: int) -> float:
        """The value at an instant."""
        return self.trajectory.at(t_ns)[self._n]

    def first_ns(self, holds: Test, low: Number, high: Number, t_ns: int) -> int:
        """The first instant after `t_ns` from which `holds` anew, or NEVER_NS."""
        return search_first(self, holds, self.trajectory.samples(t_ns), t_ns)


def search_first(curve: Any, holds: Test, samples: Iterator[int], t_ns: int) -> int:
    """The first instant after `t_ns` at which `holds` turns true, sought among samples."""
    before_ns, before = t_ns, holds(curve.at(t_ns))
    for now_ns in samples:
        now = holds(curve.at(now_ns))
        if now and not before:
            return bisect_first(curve, holds, before_ns, now_ns)
        before_ns, before = now_ns, now
    return NEVER_NS
