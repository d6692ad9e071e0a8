"""A plant without physics: its readings are what a test sets, and it notes what it was told."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from plant_sim.contract import Fact, Port, PortValue


class ToyPlant:
    """A plant with the sensors and actuators named, all real unless their name begins with `is`."""

    name = "toy"
    facts: tuple[Fact, ...] = ()

    def __init__(self, sensors: Mapping[str, PortValue], actuators: Iterable[str]) -> None:
        self.readings: dict[str, PortValue] = dict(sensors)
        self.told: list[tuple[int, dict[str, PortValue]]] = []
        self.t_ns = 0
        self.ports = (*(_port(n, "sensor") for n in sensors),
                      *(_port(n, "actuator") for n in actuators))

    def actuate(self, values: Mapping[str, PortValue]) -> None:
        self.told.append((self.t_ns, dict(values)))

    def advance(self, t_ns: int) -> None:
        self.t_ns = t_ns

    def next_event_ns(self) -> int | None:
        return None

    def sense(self) -> dict[str, PortValue]:
        return dict(self.readings)

    def observe(self) -> dict[str, Any]:
        return {}

    def watch(self, names: Iterable[str] | None = None) -> None:
        pass


def _port(name: str, direction: Any) -> Port:
    kind: Any = "bool" if name.startswith("is") else "real"
    return Port(name, direction, kind, "", -1e30, 1e30, 1.0, "")
