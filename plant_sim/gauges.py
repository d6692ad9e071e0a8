"""Sensors of hybrid automata: gauges that read a quantity in whole resolutions, and switches."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple, Protocol

from plant_sim.contract import Port
from plant_sim.curves import Curve, Number
from plant_sim.lines import exact

_HALF = Fraction(1, 2)

_ROUNDINGS: dict[str, tuple[Callable[[Any], int], Number, Number]] = {
    "nearest": (lambda x: math.floor(x + _HALF), -_HALF, _HALF),
    "up": (math.ceil, -1, 0),
    "down": (math.floor, 0, 1),
}
"""How a value in resolutions becomes a count k, and the levels beyond which it is another one."""


class Gauge(Protocol):
    """How a sensor reads a plant; the same as `hybrid.SensorReading`."""

    @property
    def quantities(self) -> frozenset[str]:
        """Names of the quantities that the reading depends on."""

    def read(self, lines: Mapping[str, Curve], t_ns: int) -> tuple[int, int]:
        """The count read at `t_ns`, and the instant at which it changes (NEVER_NS: not at all)."""


class Sensor(NamedTuple):
    """A port of a sensor and how it reads."""

    port: Port
    gauge: Gauge


@dataclass(frozen=True, slots=True)
class RealGauge:
    """Reads a quantity in resolutions, as a count within [low, high]."""

    quantity: str
    resolution: Fraction
    low: int
    high: int
    rounding: str = "nearest"

    @property
    def quantities(self) -> frozenset[str]:
        """The one quantity."""
        return frozenset((self.quantity,))

    def _of(self, value: Any) -> int:
        counted = value / self.resolution if isinstance(value, Fraction) else \
            value / float(self.resolution)
        return min(max(_ROUNDINGS[self.rounding][0](counted), self.low), self.high)

    def read(self, lines: Mapping[str, Curve], t_ns: int) -> tuple[int, int]:
        """The count read at `t_ns`, and the first instant after it at which another is."""
        curve = lines[self.quantity]
        count = self._of(curve.at(t_ns))
        _, below, above = _ROUNDINGS[self.rounding]
        low = (count + below) * self.resolution if count > self.low else -math.inf
        high = (count + above) * self.resolution if count < self.high else math.inf
        return count, curve.first_ns(lambda x: self._of(x) != count, low, high, t_ns)


@dataclass(frozen=True, slots=True)
class SwitchGauge:
    """On where a quantity is at least (or, negated, at most) a level."""

    quantity: str
    level: Fraction
    at_most: bool = False

    @property
    def quantities(self) -> frozenset[str]:
        """The one quantity."""
        return frozenset((self.quantity,))

    def _of(self, value: Any) -> int:
        return int(value <= self.level if self.at_most else value >= self.level)

    def read(self, lines: Mapping[str, Curve], t_ns: int) -> tuple[int, int]:
        """1 where it is on, else 0, and the first instant after `t_ns` at which that changes."""
        curve = lines[self.quantity]
        count = self._of(curve.at(t_ns))
        return count, curve.first_ns(lambda x: self._of(x) != count, self.level, self.level, t_ns)


# The words of `HybridAutomaton.elements`


def gauge(name: str, description: str, unit: str = "", *, low: float = 0.0, high: float,
          resolution: float, of: str = "", rounding: str = "nearest") -> Sensor:
    """A sensor of a number: reads the quantity `of`, by default the one of its name.

    Args:
        rounding: "nearest", "up" or "down".
    """
    if rounding not in _ROUNDINGS:
        raise ValueError(f"rounding {rounding!r}: expected one of {', '.join(_ROUNDINGS)}")
    step = exact(resolution)
    port = Port(name, "sensor", "real", unit, low, high, resolution, description)
    return Sensor(port, RealGauge(of or name, step, math.ceil(exact(low) / step),
                                  math.floor(exact(high) / step), rounding))


def switch(name: str, description: str, *, of: str = "", at_least: float | None = None,
           at_most: float | None = None) -> Sensor:
    """A Boolean sensor: on where the quantity `of` is at least, or at most, a level.

    Without a level it is on where the quantity is True.
    """
    port = Port(name, "sensor", "bool", "", 0, 1, 1, description)
    level = at_least if at_most is None else at_most
    return Sensor(port, SwitchGauge(of or name, exact(1 if level is None else level),
                                    at_most is not None))


def actuator(name: str, description: str, unit: str = "", *, high: float | None = None,
             low: float = 0.0, resolution: float = 0.0) -> Port:
    """An actuator: Boolean, or real where `high` is given."""
    return _driven(name, "actuator", description, unit, low, high, resolution)


def disturbance(name: str, description: str, unit: str = "", *, high: float | None = None,
                low: float = 0.0, resolution: float = 0.0) -> Port:
    """What nature may do: Boolean, or real where `high` is given; absent at `low`."""
    return _driven(name, "disturbance", description, unit, low, high, resolution)


def _driven(name: str, direction: Any, description: str, unit: str, low: float,
            high: float | None, resolution: float) -> Port:
    if high is None:
        return Port(name, direction, "bool", unit, 0, 1, 1, description)
    return Port(name, direction, "real", unit, low, high, resolution or (high - low) / 1000,
                description)
