"""Field devices: what stands between a plant and the PLC's terminals, with its imperfections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from plant_sim.chance import normal
from plant_sim.contract import Port, PortValue
from plant_sim.curves import NS_PER_S
from plant_sim.lines import NEVER_NS, exact, seconds_to_ns

SAMPLE_NS = 100_000_000
"""Time between two draws of a sensor's noise, where nothing else is said, ns."""


@dataclass(frozen=True, slots=True)
class Device:
    """How a sensor or actuator is imperfect by nature; all that is 0 is ideal.

    Attributes:
        noise: standard deviation of a sensor's reading, in its unit.
        sample_ns: time between two draws of the noise.
        resolution: of a sensor's reading, in its unit; 0 for the port's own.
        delay_ns: how old a sensor's reading is.
        drift_per_s: what a sensor reads too much after each s, in its unit.
        travel_ns: what an actuator needs from end to end.
    """

    noise: float = 0.0
    sample_ns: int = SAMPLE_NS
    resolution: float = 0.0
    delay_ns: int = 0
    drift_per_s: float = 0.0
    travel_ns: int = 0


@dataclass(slots=True)
class Active:
    """A fault that lasts: since when, and what was the case when it began."""

    fault: str
    value: PortValue | None
    since_ns: int
    held: int = 0


Faults = list[Active]


def _with(faults: Faults, *names: str) -> Active | None:
    """The latest active fault of these names."""
    return next((active for active in reversed(faults) if active.fault in names), None)


def _sum(faults: Faults, name: str) -> float:
    return math.fsum(float(active.value or 0) for active in faults if active.fault == name)


@dataclass(slots=True)
class Transmitter:
    """A sensor's device: from counts of the plant's own port to counts that the PLC sees.

    Both count in whole resolutions, the second in those of `port`.
    """

    port: Port
    inner: Port
    device: Device
    seed: int
    faults: Faults = field(default_factory=list)
    history: list[tuple[int, int]] = field(default_factory=list)
    """Changes of the plant's count (t_ns, count), as far back as the delay, oldest first."""

    @property
    def delay_ns(self) -> int:
        """How old a reading is."""
        slow = _with(self.faults, "slow")
        return self.device.delay_ns + (seconds_to_ns(float(slow.value or 0)) if slow else 0)

    def record(self, t_ns: int, count: int) -> None:
        """Note the plant's count now; forget what nothing will show any more."""
        history = self.history
        if not history or history[-1][1] != count:
            history.append((t_ns, count))
        while len(history) > 1 and history[1][0] <= t_ns - self.delay_ns:
            del history[0]

    def count(self, t_ns: int, now: int) -> int:
        """The count that the PLC sees, given the plant's count now."""
        stuck = _with(self.faults, "stuck", "open", "lost")
        if stuck is not None:
            return self._stuck(stuck)
        seen = self._delayed(t_ns, now)
        if self._is_ideal():
            return seen
        return self._clamped(math.floor(self._value(t_ns, seen) / exact(self.port.resolution)
                                        + Fraction(1, 2)))

    def _stuck(self, active: Active) -> int:
        if active.fault != "stuck":
            return self._counts(self.port.low)
        return active.held if active.value is None else self._counts(float(active.value))

    def _counts(self, value: float) -> int:
        return self._clamped(round(exact(value) / exact(self.port.resolution)))

    def _clamped(self, count: int) -> int:
        step = exact(self.port.resolution)
        low, high = math.ceil(exact(self.port.low) / step), math.floor(exact(self.port.high) / step)
        return min(max(count, low), high)

    def _delayed(self, t_ns: int, now: int) -> int:
        if not self.delay_ns or not self.history:
            return now
        shown = [count for t0_ns, count in self.history if t0_ns <= t_ns - self.delay_ns]
        return shown[-1] if shown else self.history[0][1]

    def _is_ideal(self) -> bool:
        return not (self._sigma() or self._rate() or self.faults) \
            and self.port.resolution == self.inner.resolution

    def _sigma(self) -> float:
        return math.hypot(self.device.noise, _sum(self.faults, "noise"))

    def _rate(self) -> Fraction:
        return exact(self.device.drift_per_s) + exact(_sum(self.faults, "drift"))

    def _value(self, t_ns: int, seen: int) -> Fraction:
        """What is read before quantisation, in the port's unit."""
        value = seen * exact(self.inner.resolution) + exact(_sum(self.faults, "offset"))
        value += exact(self.device.drift_per_s) * Fraction(t_ns, NS_PER_S)
        for active in self.faults:
            if active.fault == "drift":
                value += exact(float(active.value or 0)) \
                    * Fraction(t_ns - active.since_ns, NS_PER_S)
        if sigma := self._sigma():
            drawn = normal(self.seed, self.port.name, t_ns // self.device.sample_ns)
            value += Fraction(sigma * drawn)
        if _with(self.faults, "wrong_sign"):
            value = exact(self.port.low) + exact(self.port.high) - value
        return value

    def next_change_ns(self, t_ns: int, now: int) -> int:
        """The first instant after now at which the reading may change while the plant's stays."""
        if _with(self.faults, "stuck", "open", "lost"):
            return NEVER_NS
        nexts = [t0_ns + self.delay_ns for t0_ns, _ in self.history
                 if t0_ns + self.delay_ns > t_ns] if self.delay_ns else []
        if self._sigma():
            nexts.append((t_ns // self.device.sample_ns + 1) * self.device.sample_ns)
        if self._rate():
            nexts.append(self._next_by_drift(t_ns, now))
        return min(nexts, default=NEVER_NS)

    def _next_by_drift(self, t_ns: int, now: int) -> int:
        seen, step = self._delayed(t_ns, now), exact(self.port.resolution)
        value = self._value(t_ns, seen)
        rate = self._rate() / NS_PER_S * (-1 if _with(self.faults, "wrong_sign") else 1)
        count = math.floor(value / step + Fraction(1, 2))
        edge = (count + (Fraction(1, 2) if rate > 0 else -Fraction(1, 2))) * step
        # Falling, the edge itself still belongs to the count: one ns later is safe.
        return t_ns + max(1, math.ceil((edge - value) / rate) + (rate < 0))


@dataclass(slots=True)
class Drive:
    """An actuator's device: from the command to what the plant's own port gets.

    Its place is counted in ns of travel, 0 at the low end and `travel_ns` at the high one; it moves
    one a ns. What is on or off switches at the end of the travel; a number moves by resolutions.
    """

    port: Port
    device: Device
    command: PortValue
    output: PortValue
    faults: Faults = field(default_factory=list)
    place: int = 0
    t_ns: int = 0

    @property
    def travel_ns(self) -> int:
        """What it needs from end to end."""
        slow = _with(self.faults, "slow")
        return seconds_to_ns(float(slow.value or 0)) if slow else self.device.travel_ns

    def move(self, t_ns: int) -> None:
        """Bring the place, and with it the output, to an instant."""
        way = t_ns - self.t_ns
        self.t_ns = t_ns
        stuck = _with(self.faults, "stuck")
        if stuck is not None:
            if stuck.value is not None:
                self._jump(stuck.value)
            return
        goal, travel_ns = self._goal(), self.travel_ns
        target = self._place_of(goal, travel_ns)
        self.place = min(self.place + way, target) if self.place < target \
            else max(self.place - way, target)
        self.output = goal if self.place == target else self._between(travel_ns)

    def rescale(self, before_ns: int) -> None:
        """Keep the place, as a part of the whole way, when the travel time changes."""
        now_ns = self.travel_ns
        self.place = self._place_of(self.output, now_ns) if not before_ns \
            else self.place * now_ns // before_ns

    def _jump(self, value: PortValue) -> None:
        self.output, self.place = value, self._place_of(value, self.travel_ns)

    def _goal(self) -> PortValue:
        fixed = _with(self.faults, "open", "closed")
        if fixed is not None:
            return self._as_value(self.port.high if fixed.fault == "open" else self.port.low)
        if _with(self.faults, "wrong_sign"):
            return self._as_value(self.port.low + self.port.high - float(self.command))
        return self.command

    def _as_value(self, value: float) -> PortValue:
        return bool(value) if self.port.kind == "bool" else value

    def _place_of(self, value: PortValue, travel_ns: int) -> int:
        span = exact(self.port.high) - exact(self.port.low)
        return round((exact(float(value)) - exact(self.port.low)) / span * travel_ns)

    def _between(self, travel_ns: int) -> PortValue:
        if self.port.kind == "bool":
            return self.output
        step = exact(self.port.resolution)
        span = exact(self.port.high) - exact(self.port.low)
        steps = math.floor(self.place * span / step / travel_ns)
        return float(exact(self.port.low) + steps * step)

    def next_ns(self) -> int:
        """The next instant at which the output may change by itself."""
        if _with(self.faults, "stuck") is not None:
            return NEVER_NS
        travel_ns = self.travel_ns
        target = self._place_of(self._goal(), travel_ns)
        if self.place == target:
            return NEVER_NS
        if self.port.kind == "bool":
            return self.t_ns + abs(target - self.place)
        steps = (exact(self.port.high) - exact(self.port.low)) / exact(self.port.resolution)
        at = self.place * steps / travel_ns
        if target > self.place:
            edge = min(math.ceil((math.floor(at) + 1) * travel_ns / steps), target)
        else:
            edge = max(math.ceil(math.floor(at) * travel_ns / steps) - 1, target)
        return self.t_ns + max(abs(edge - self.place), 1)


def fault_image(faults: Faults) -> list[list[Any]]:
    """Active faults as plain lists."""
    return [[a.fault, a.value, a.since_ns, a.held] for a in faults]


def faults_from(image: list[list[Any]]) -> Faults:
    """The active faults that `fault_image` described."""
    return [Active(*row) for row in image]


def port_of(port: Port, device: Device) -> Port:
    """The port as the PLC sees it through a device."""
    if port.kind == "bool" or not device.resolution:
        return port
    return Port(port.name, port.direction, port.kind, port.unit, port.low, port.high,
                device.resolution, port.description)


def check_devices(devices: Mapping[str, Device], ports: Mapping[str, Port]) -> None:
    """Raises ValueError, with the port's name first, for a device that a port cannot have."""
    for name, device in devices.items():
        port = ports.get(name)
        if port is None or port.direction == "disturbance":
            raise ValueError(f"{name}: the plant has no such sensor or actuator")
        for_sensors = bool(device.noise or device.resolution or device.delay_ns
                           or device.drift_per_s)
        if port.direction == "actuator" and for_sensors:
            raise ValueError(f"{name}: is an actuator, which can have a travel time only")
        if port.direction == "sensor" and device.travel_ns:
            raise ValueError(f"{name}: is a sensor, which has no travel time")
        if port.kind == "bool" and (device.noise or device.resolution or device.drift_per_s):
            raise ValueError(f"{name}: is on or off, which can have a delay only")
