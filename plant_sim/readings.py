"""Quantised sensors on exact quantities: what is read now, and when that will change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from plant_sim.lines import NEVER_NS, Course, Form, Line, first_not_negative, first_positive


class Rounding(Enum):
    """How a sensor turns a measured value x (in resolutions) into a whole count k."""

    CEILING = "ceiling"
    """k for k - 1 < x <= k: 0 is read only at exactly 0, k as soon as x has fallen to k."""
    NEAREST = "nearest"
    """k for k - 1/2 <= x < k + 1/2."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A sensor that reads top / bottom as a count within [low, high].

    `top` and `bottom` are scaled so that their quotient is in resolutions; `bottom` is never
    negative, and where it is 0 (an empty tank has no temperature) the count is `undefined`.
    """

    top: Form
    bottom: Form
    rounding: Rounding
    low: int
    high: int
    undefined: int = 0

    @property
    def quantities(self) -> frozenset[str]:
        """Names of the quantities that the reading depends on."""
        return frozenset(name for name, _ in self.top.terms + self.bottom.terms)

    def read(self, lines: Mapping[str, Line], t_ns: int) -> tuple[int, int]:
        """The count read at `t_ns`, and the first instant after it with another, or NEVER_NS.

        True as long as the lines stay.
        """
        top, bottom = self.top.seen(lines, t_ns), self.bottom.seen(lines, t_ns)
        if bottom.value <= 0:
            return self.undefined, self._change_when_defined(lines, t_ns, bottom)
        if not bottom.slope:
            return self._read_over(top, bottom.value * top.den, bottom.den, t_ns)
        count = self._count(top, bottom)
        dt = NEVER_NS
        if count < self.high:
            dt = self._until_above(top, bottom, count)
        if count > self.low:
            dt = min(dt, self._until_below(top, bottom, count))
        return count, t_ns + dt if dt < NEVER_NS else NEVER_NS

    def _read_over(self, top: Course, unit: int, factor: int, t_ns: int) -> tuple[int, int]:
        """The same where `unit` stays, for top * factor / unit: by far the most frequent case."""
        value, slope = top.value * factor, top.slope * factor
        ceiling = self.rounding is Rounding.CEILING
        count = -(-value // unit) if ceiling else (2 * value + unit) // (2 * unit)
        count = min(max(count, self.low), self.high)
        dt = NEVER_NS
        if slope > 0 and count < self.high:
            dt = first_positive(value - count * unit, slope) if ceiling else \
                first_not_negative(2 * value - (2 * count + 1) * unit, 2 * slope)
        elif slope < 0 and count > self.low:
            dt = first_not_negative((count - 1) * unit - value, -slope) if ceiling else \
                first_positive((2 * count - 1) * unit - 2 * value, -2 * slope)
        return count, t_ns + dt if dt < NEVER_NS else NEVER_NS

    def _count(self, top: Course, bottom: Course) -> int:
        above, below = top.value * bottom.den, bottom.value * top.den
        if self.rounding is Rounding.CEILING:
            count = -(-above // below)
        else:
            count = (2 * above + below) // (2 * below)
        return min(max(count, self.low), self.high)

    def _change_when_defined(self, lines: Mapping[str, Line], t_ns: int, bottom: Course) -> int:
        if bottom.slope <= 0:
            return NEVER_NS
        first_ns = t_ns + first_positive(bottom.value, bottom.slope)
        count, change_ns = self.read(lines, first_ns)
        return first_ns if count != self.undefined else change_ns

    def _until_above(self, top: Course, bottom: Course, count: int) -> int:
        if self.rounding is Rounding.CEILING:
            return first_positive(*_difference(1, top, count, bottom))
        return first_not_negative(*_difference(2, top, 2 * count + 1, bottom))

    def _until_below(self, top: Course, bottom: Course, count: int) -> int:
        if self.rounding is Rounding.CEILING:
            return first_not_negative(*_difference(-1, top, 1 - count, bottom))
        return first_positive(*_difference(-2, top, 1 - 2 * count, bottom))


def _difference(a: int, top: Course, b: int, bottom: Course) -> tuple[int, int]:
    """Value and slope of a * top - b * bottom, up to a positive factor."""
    p, q = a * bottom.den, b * top.den
    return p * top.value - q * bottom.value, p * top.slope - q * bottom.slope
