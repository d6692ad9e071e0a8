"""Exact straight lines over integer time: the arithmetic that piecewise-linear plants share.

Quantities are whole numbers of a small quantum, slopes are rational, instants are integer ns. So
every evaluation and every crossing is exact, and none depends on how time was cut into pieces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

NEVER_NS = 1 << 127
"""An instant after every other."""


class Line(NamedTuple):
    """A quantity `value + num / den * (t - t0_ns)` in quanta, anchored at `t0_ns`; den > 0."""

    value: int
    num: int = 0
    den: int = 1
    t0_ns: int = 0

    def at(self, t_ns: int) -> int:
        """The value at `t_ns`, rounded to the nearest quantum (exact if den is 1)."""
        if not self.num:
            return self.value
        rise = self.num * (t_ns - self.t0_ns)
        return self.value + (2 * rise + self.den) // (2 * self.den)

    def with_slope(self, slope: Fraction, t_ns: int) -> Line:
        """The line that goes on with another slope (quanta per ns) from `t_ns`."""
        if slope.numerator == self.num and slope.denominator == self.den:
            return self
        return Line(self.at(t_ns), slope.numerator, slope.denominator, t_ns)

    def with_value(self, value: int, t_ns: int) -> Line:
        """The line that goes on with the same slope from another value at `t_ns`."""
        return Line(value, self.num, self.den, t_ns)


class Course(NamedTuple):
    """A linear function seen from an instant: `(value + slope * dt) / den` after dt ns; den > 0."""

    value: int
    slope: int
    den: int


@dataclass(frozen=True, slots=True)
class Form:
    """A linear combination of quantities: the sum of coefficient * quantity, plus a constant."""

    terms: tuple[tuple[str, int], ...]
    constant: int = 0

    def seen(self, lines: Mapping[str, Line], t_ns: int) -> Course:
        """The combination as a function of the time after `t_ns`, without rounding."""
        if not self.terms:
            return Course(self.constant, 0, 1)
        if len(self.terms) == 1:
            ((name, factor),) = self.terms
            start, num, den, t0_ns = lines[name]
            here = start * den + num * (t_ns - t0_ns)
            return Course(self.constant * den + factor * here, factor * num, den)
        value, slope, den = self.constant, 0, 1
        for name, factor in self.terms:
            line = lines[name]
            here = line.value * line.den + line.num * (t_ns - line.t0_ns)
            if line.den != den:
                value, slope = value * line.den, slope * line.den
                here, rise = here * den, line.num * den
                den *= line.den
            else:
                rise = line.num
            value += factor * here
            slope += factor * rise
        return Course(value, slope, den)


def first_not_negative(value: int, slope: int) -> int:
    """The least whole dt >= 0 with value + slope * dt >= 0, or NEVER_NS."""
    if value >= 0:
        return 0
    return -(value // slope) if slope > 0 else NEVER_NS


def first_positive(value: int, slope: int) -> int:
    """The least whole dt >= 0 with value + slope * dt > 0, or NEVER_NS."""
    if value > 0:
        return 0
    return -value // slope + 1 if slope > 0 else NEVER_NS


def exact(number: float | Fraction) -> Fraction:
    """The decimal number that a float was written as: 0.1 is one tenth."""
    return Fraction(repr(number)) if isinstance(number, float) else Fraction(number)


def seconds_to_ns(seconds: float) -> int:
    """Seconds as whole ns, rounded to the nearest."""
    return round(exact(seconds) * 1_000_000_000)
