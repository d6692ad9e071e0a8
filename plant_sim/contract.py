"""The plant contract: what a PLC, a test bench or a checker may ask of any plant.

A plant has *ports* and *facts*. Sensors and actuators can be wired to a PLC; disturbances are what
nature does to the plant (a leak, a failing condenser). Facts are what an observer may know but no
sensor shows: an overflow, a count of batches. Ports carry units and never addresses. Time is an
integer of nanoseconds that only `advance` moves, and the partition of a stretch of time into calls
of `advance` never changes a result.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from plant_sim.parameters import Parameters

PortValue = bool | float
FactValue = bool | int | float


@dataclass(frozen=True, slots=True)
class Port:
    """One sensor, actuator or disturbance of a plant.

    `low`, `high` and `resolution` are in `unit`. A real sensor reads whole multiples of its
    resolution; for a Boolean port low, high and resolution are 0, 1 and 1. An actuator is off, and
    a disturbance absent, at `low`.
    """

    name: str
    direction: Literal["sensor", "actuator", "disturbance"]
    kind: Literal["bool", "real"]
    unit: str
    low: float
    high: float
    resolution: float
    description: str


@dataclass(frozen=True, slots=True)
class Fact:
    """Something true of a plant that can be observed but not wired."""

    name: str
    kind: Literal["bool", "int", "real"]
    unit: str
    description: str


@runtime_checkable
class Plant(Protocol):
    """A process that a PLC controls.

    Every plant class is constructed from one optional mapping of parameters (or its own
    `Parameters` object) and is then at `t_ns == 0` with every actuator off.
    """

    @property
    def name(self) -> str:
        """The kind of plant, as in the registry."""

    @property
    def parameters(self) -> Parameters:
        """The checked parameters of this plant."""

    @property
    def ports(self) -> tuple[Port, ...]:
        """Sensors and actuators, in a fixed order."""

    @property
    def facts(self) -> tuple[Fact, ...]:
        """What `observe` returns, in a fixed order."""

    @property
    def t_ns(self) -> int:
        """Plant time in ns since `reset`."""

    def reset(self) -> None:
        """Back to the initial state at `t_ns == 0`, all actuators off; what is watched stays."""

    def actuate(self, values: Mapping[str, PortValue]) -> None:
        """Set the named actuators together at the present instant; the others keep their value.

        Raises ValueError for a name that is no actuator.
        """

    def disturb(self, values: Mapping[str, PortValue]) -> None:
        """Set the named disturbances together at the present instant; the others keep their value.

        Raises ValueError for a name that is no disturbance.
        """

    def advance(self, t_ns: int) -> None:
        """Move to exactly `t_ns`. Raises ValueError if that is in the past."""

    def next_event_ns(self) -> int | None:
        """Earliest instant after `t_ns` at which a watched reading or a fact changes.

        It holds for as long as no actuator or disturbance changes; None if nothing will ever
        change. A plant that goes through very many modes without showing anything may name an
        earlier instant.
        """

    def sense(self) -> dict[str, PortValue]:
        """Present readings of the watched sensors; reals as the float nearest to k * resolution."""

    def counts(self) -> dict[str, int]:
        """The same readings as whole numbers of resolutions (Booleans 0 or 1): exact for a PLC."""

    def observe(self) -> dict[str, FactValue]:
        """Present values of all facts."""

    def watch(self, names: Iterable[str] | None = None) -> None:
        """Let only these sensors cause events and appear in `sense` and `counts`; None: all.

        Raises ValueError for a name that is no sensor.
        """

    def snapshot(self) -> dict[str, Any]:
        """The complete state, ready for JSON."""

    def restore(self, image: Mapping[str, Any]) -> None:
        """Continue bit-identically from a snapshot of a plant with the same parameters.

        Raises ValueError for a snapshot of another plant.
        """

    def report(self) -> dict[str, Any]:
        """Summary of the run so far, ready for JSON."""
