"""How quantities go on within a mode: laws of motion and, from an anchor on, their curves.

A *law* says how a quantity changes (a rate, an outflow, an approach); with a value at an instant it
becomes a *curve*, a function of the time in ns. Straight lines are exact rationals; the others are
closed forms in floating point. Both are monotone, so the first instant beyond a level is found to
the ns: guessed by the inverse, then settled by bisection between neighbouring ns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol

from plant_sim.lines import NEVER_NS, exact

NS_PER_S = 1_000_000_000
Number = int | float | Fraction
Test = Callable[[Any], bool]

_GALLOP_LIMIT = 1 << 62
"""How far beyond its guess an instant is sought, ns (146 years)."""


class Curve(Protocol):
    """A quantity as a function of time from its anchor (`t0_ns`, `value`) on."""

    t0_ns: int
    value: Any

    def at(self, t_ns: int) -> Any:
        """The value at an instant not before the anchor; a Fraction where it is exact."""

    def first_ns(self, holds: Test, low: Number, high: Number, t_ns: int) -> int:
        """The first instant after `t_ns` from which `holds`, or NEVER_NS.

        `holds` is a test of the value that is false at `t_ns` and turns true where the value falls
        to `low` or rises to `high`; if it is true at `t_ns` it cannot begin.
        """


class Law(Protocol):
    """How one quantity changes by itself, as plain data."""

    def curve(self, value: Any, t0_ns: int) -> Curve:
        """The curve from a value at an instant."""


# Constants


@dataclass(frozen=True, slots=True)
class StillCurve:
    """A quantity that does not change, of any type."""

    value: Any
    t0_ns: int

    def at(self, t_ns: int) -> Any:
        """The value."""
        return self.value

    def first_ns(self, holds: Test, low: Number, high: Number, t_ns: int) -> int:
        """Never: nothing changes."""
        return NEVER_NS


@dataclass(frozen=True, slots=True)
class Still:
    """No change: the law of every quantity that a mode gives no other."""

    def curve(self, value: Any, t0_ns: int) -> StillCurve:
        """The curve from a value at an instant."""
        return StillCurve(value, t0_ns)


STILL = Still()


# Straight lines


class LinearCurve:
    """`(a + b * (t - t0_ns)) / d`, exact."""

    __slots__ = ("_a", "_b", "_d", "t0_ns", "value")

    def __init__(self, value: Fraction, per_ns: Fraction, t0_ns: int) -> None:
        self.value, self.t0_ns = value, t0_ns
        self._d = math.lcm(value.denominator, per_ns.denominator)
        self._a = value.numerator * (self._d // value.denominator)
        self._b = per_ns.numerator * (self._d // per_ns.denominator)

    def at(self, t_ns: int) -> Fraction | float:
        """The exact value at an instant in whole ns; a float between two of them."""
        top = self._a + self._b * (t_ns - self.t0_ns)
        return Fraction(top, self._d) if isinstance(top, int) else top / self._d

    def first_ns(self, holds: Test, low: Number, high: Number, t_ns: int) -> int:
        """The first instant after `t_ns` from which `holds`, or NEVER_NS."""
        level = high if self._b > 0 else low
        if not self._b or not math.isfinite(level):
            return NEVER_NS
        level = exact(level)
        way = level.numerator * self._d - self._a * level.denominator
        slope = self._b * level.denominator
        return settle_first(self, holds, self.t0_ns - (-way // slope), t_ns)


@dataclass(frozen=True, slots=True)
class Linear:
    """A constant rate in units per s; a float is taken for the decimal number it is written as."""

    rate: Number

    def curve(self, value: Any, t0_ns: int) -> Curve:
        """The curve from a value at an instant."""
        return LinearCurve(_rational(value), exact(self.rate) / NS_PER_S, t0_ns)


def _rational(value: Any) -> Fraction:
    return value if isinstance(value, Fraction) else exact(value)


# Closed forms


class _ClosedForm:
    """A monotone curve that knows its value and, roughly, when it reaches a level."""

    __slots__ = ("_law", "t0_ns", "value")

    def __init__(self, law: Any, value: float, t0_ns: int) -> None:
        self._law, self.value, self.t0_ns = law, value, t0_ns

    def at(self, t_ns: int) -> float:
        """The value at an instant."""
        x: float = self._law.after(self.value, (t_ns - self.t0_ns) / NS_PER_S)
        return x

    def first_ns(self, holds: Test, low: Number, high: Number, t_ns: int) -> int:
        """The first instant after `t_ns` from which `holds`, or NEVER_NS."""
        level = high if self._law.rises(self.value) else low
        if not math.isfinite(level):
            return NEVER_NS
        wait_s = self._law.until(self.value, float(level))
        if not wait_s < _GALLOP_LIMIT / NS_PER_S:
            return NEVER_NS
        return settle_first(self, holds, self.t0_ns + math.ceil(wait_s * NS_PER_S), t_ns)


@dataclass(frozen=True, slots=True)
class Torricelli:
    """Outflow through a hole by its own weight: x' = -k * sqrt(x) in units per s, down to 0.

    The root of x falls evenly: x(t) = (sqrt(x0) - k * t / 2)^2. For a tank of ground area G with
    a hole of area A, level h in m: k = A * sqrt(2 g) / G.
    """

    k: float

    def curve(self, value: Any, t0_ns: int) -> Curve:
        """The curve from a value at an instant."""
        return _ClosedForm(self, float(value), t0_ns)

    def after(self, x: float, s: float) -> float:
        """The value `s` seconds after it was `x`."""
        root = math.sqrt(max(x, 0.0)) - self.k * s / 2
        return min(root * root, x) if root > 0 else 0.0

    def until(self, x: float, level: float) -> float:
        """Seconds from `x` to a level, infinite if it is never reached."""
        if not 0 <= level <= x or not self.k > 0:
            return math.inf
        return 2 * (math.sqrt(x) - math.sqrt(level)) / self.k

    def rises(self, x: float) -> bool:
        """Whether the value rises from `x`."""
        return False


@dataclass(frozen=True, slots=True)
class Approach:
    """First-order lag: x' = (target - x) / tau_s, as in Newton's law of cooling."""

    target: float
    tau_s: float

    def curve(self, value: Any, t0_ns: int) -> Curve:
        """The curve from a value at an instant."""
        return _ClosedForm(self, float(value), t0_ns)

    def after(self, x: float, s: float) -> float:
        """The value `s` seconds after it was `x`."""
        return x - (self.target - x) * math.expm1(-s / self.tau_s)

    def until(self, x: float, level: float) -> float:
        """Seconds from `x` to a level, infinite if it is never reached."""
        way, whole = level - x, self.target - x
        if not whole or not 0 <= way / whole < 1:
            return math.inf
        return -self.tau_s * math.log1p(-way / whole)

    def rises(self, x: float) -> bool:
        """Whether the value rises from `x`."""
        return self.target > x


@dataclass(frozen=True, slots=True)
class Caught:
    """What another quantity gives away by `Torricelli`: x' = share * k * sqrt(source).

    `source` is the other's value where this law begins; so the law is anchored where it is made.
    """

    share: float
    outflow: Torricelli
    source: float

    def curve(self, value: Any, t0_ns: int) -> Curve:
        """The curve from a value at an instant."""
        return _ClosedForm(self, float(value), t0_ns)

    def after(self, x: float, s: float) -> float:
        """The value `s` seconds after it was `x`."""
        return x + self.share * (self.source - self.outflow.after(self.source, s))

    def until(self, x: float, level: float) -> float:
        """Seconds from `x` to a level, infinite if it is never reached."""
        return self.outflow.until(self.source, self.source - (level - x) / self.share)

    def rises(self, x: float) -> bool:
        """Whether the value rises from `x`."""
        return self.share > 0


# Finding instants


class _Readable(Protocol):
    def at(self, t_ns: int) -> Any:
        """The value at an instant."""


def settle_first(curve: _Readable, holds: Test, guess_ns: int, t_ns: int) -> int:
    """The first instant after `t_ns` from which `holds` on a monotone curve, near a guess.

    NEVER_NS if it holds at `t_ns` already, or nowhere within `_GALLOP_LIMIT` of the guess.
    """
    if holds(curve.at(t_ns)):
        return NEVER_NS
    guess_ns = max(guess_ns, t_ns + 1)
    step = 1
    if holds(curve.at(guess_ns)):
        low, high = guess_ns - 1, guess_ns
        while low > t_ns and holds(curve.at(low)):
            high, low, step = low, max(low - step, t_ns), step * 4
        low = max(low, t_ns)
    else:
        low, high = guess_ns, guess_ns + 1
        while not holds(curve.at(high)):
            if step > _GALLOP_LIMIT:
                return NEVER_NS
            low, high, step = high, high + step, step * 4
    return bisect_first(curve, holds, low, high)


def bisect_first(curve: _Readable, holds: Test, low_ns: int, high_ns: int) -> int:
    """The instant in (low, high] from which `holds`, which is false at low and true at high."""
    while high_ns - low_ns > 1:
        middle = (low_ns + high_ns) // 2
        if holds(curve.at(middle)):
            high_ns = middle
        else:
            low_ns = middle
    return high_ns
