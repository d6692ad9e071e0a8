"""A plant coupled to a process image, wherever that image is.

In each step the coupling does the same three things in the same order: take the outputs, advance
the plant, give the inputs. In the process it works on the exchange; behind Modbus a client carries
the same raw values (docs/timing.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from plant_sim.contract import Plant
from plcemu.base.areas import parse_address
from plcemu.base.errors import PlcemuError, did_you_mean
from plcemu.io.mapping import Point


class CouplingError(PlcemuError):
    """The wiring does not fit the plant; `name` is the port that is wired wrong."""

    def __init__(self, name: str, problem: str) -> None:
        self.name = name
        super().__init__(problem)


def points(wiring: Mapping[str, tuple[str, Fraction]], known: Iterable[str]) -> list[Point]:
    """Return a wiring as points: port name to (address, scale).

    Raises:
        CouplingError: a name is no port of the plant, or two share an address.
    """
    names, made, taken = list(known), [], dict[str, str]()
    for name, (address, scale) in wiring.items():
        if name not in names:
            raise CouplingError(name, f"the plant has no such port here{did_you_mean(name, names)}")
        point = Point(name, parse_address(address), scale)
        if str(point.address) in taken:
            raise CouplingError(name, f"{taken[str(point.address)]} has {point.address} already")
        taken[str(point.address)] = name
        made.append(point)
    return made


class Checkpoint(NamedTuple):
    """The state of a coupling.

    Attributes:
        plant: snapshot of the plant.
        origin_ns: the plant's time at the PLC's instant 0.
        outputs: the raw values of the outputs that the actuators follow; None for none yet.
    """

    plant: Mapping[str, Any]
    origin_ns: int
    outputs: Sequence[int] | None


class Coupling:
    """A plant, its wiring, and the relation of its time to the PLC's.

    Args:
        plant: the plant; only its wired sensors are watched.
        inputs: where the readings of its sensors go.
        outputs: what its actuators follow.
        time_scale: plant time for each unit of the PLC's time.
    """

    def __init__(self, plant: Plant, inputs: Sequence[Point], outputs: Sequence[Point],
                 time_scale: Fraction = Fraction(1)) -> None:
        self.plant = plant
        self.inputs, self.outputs = tuple(inputs), tuple(outputs)
        self._scale = time_scale
        self._origin_ns = plant.t_ns
        self._outputs_before: Sequence[int] | None = None
        plant.watch([p.name for p in self.inputs])

    def begin(self, t_ns: int) -> None:
        """Let the plant, as it stands, begin at an instant of the PLC's time."""
        self._origin_ns = self.plant.t_ns - int(t_ns * self._scale)
        self._outputs_before = None

    def plant_time_ns(self, t_ns: int) -> int:
        """Return the plant's time at an instant of the PLC's time."""
        return self._origin_ns + int(t_ns * self._scale)

    def next_event_ns(self) -> int | None:
        """Return the first instant of the PLC's time at which a reading or a fact has changed."""
        event = self.plant.next_event_ns()
        if event is None:
            return None
        wait = Fraction(event - self._origin_ns) / self._scale
        return -(-wait.numerator // wait.denominator)

    def checkpoint(self) -> Checkpoint:
        """Return the state of plant and coupling, to which an equal coupling can return."""
        return Checkpoint(self.plant.snapshot(), self._origin_ns, self._outputs_before)

    def return_to(self, point: Checkpoint) -> None:
        """Take up the state of a checkpoint."""
        self.plant.restore(point.plant)
        self._origin_ns, self._outputs_before = point.origin_ns, point.outputs

    def take_outputs(self, raw: Sequence[int]) -> bool:
        """Let the actuators follow the outputs' raw values; return whether any changed."""
        if raw == self._outputs_before:
            return False
        self._outputs_before = list(raw)
        self.plant.actuate({p.name: p.to_value(r)
                            for p, r in zip(self.outputs, raw, strict=True)})
        return True

    def advance(self, t_ns: int) -> None:
        """Bring the plant to an instant of the PLC's time."""
        target = self.plant_time_ns(t_ns)
        if target > self.plant.t_ns:
            self.plant.advance(target)

    def give_inputs(self) -> list[int]:
        """Return the raw values of the inputs, in the order of `inputs`."""
        sensed = self.plant.sense()
        return [p.to_raw(sensed[p.name]) for p in self.inputs]
