"""A plant coupled to a process image, wherever that image is.

In each step the coupling does the same three things in the same order: take the outputs, advance
the plant, give the inputs. In the process it works on the exchange; behind Modbus a client carries
the same raw values (docs/timing.md).
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from operator import itemgetter
from typing import Any, NamedTuple

from plant_sim.contract import Plant, PortValue
from plcemu.base.areas import parse_address
from plcemu.base.errors import PlcemuError, did_you_mean
from plcemu.base.time import NS_PER_S
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


def picker(names: Sequence[str]) -> Callable[[Mapping[str, Any]], tuple[Any, ...]]:
    """Return what takes the values of these names from a mapping, in their order."""
    if len(names) > 1:
        return itemgetter(*names)
    return lambda mapping: tuple([mapping[name] for name in names])


_KNOWN_LIMIT = 4096
"""Readings of one sensor whose raw values are remembered: a quantised sensor repeats itself."""


class PlantFailure(PlcemuError):
    """The plant's model failed: which plant, when, and the line of its code."""


class Checkpoint(NamedTuple):
    """The state of a coupling.

    Attributes:
        plant: snapshot of the plant.
        origin_ns: the plant's time at the PLC's instant 0.
        outputs: the raw values of the outputs that the actuators follow; None for none yet.
        held: of outputs that act at the next release only; None if there are none.
        now_ns: the PLC's instant up to which the plant has come.
    """

    plant: Mapping[str, Any]
    origin_ns: int
    outputs: Sequence[int] | None
    held: Sequence[int] | None = None
    now_ns: int = 0


class Coupling:
    """A plant, its wiring, and the relation of its time to the PLC's.

    Args:
        plant: the plant; only its wired sensors are watched.
        inputs: where the readings of its sensors go.
        outputs: what its actuators follow.
        time_scale: plant time for each unit of the PLC's time.
        delayed: whether outputs act at the release after the scan that set them, as of a PLC that
            writes its outputs at the end of its cycle; else they act at once.
    """

    def __init__(self, plant: Plant, inputs: Sequence[Point], outputs: Sequence[Point],
                 time_scale: Fraction = Fraction(1), delayed: bool = False) -> None:
        self.plant = plant
        self.inputs, self.outputs = tuple(inputs), tuple(outputs)
        self._per = time_scale.as_integer_ratio()
        self._known: list[dict[PortValue, int]] = [{} for _ in self.inputs]
        self._origin_ns = plant.t_ns
        self._outputs_before: Sequence[int] | None = None
        self._delayed = delayed
        self._held: Sequence[int] | None = None
        self._now_ns = 0
        plant.watch([p.name for p in self.inputs])

    def begin(self, t_ns: int) -> None:
        """Let the plant, as it stands, begin at an instant of the PLC's time."""
        self._origin_ns = self.plant.t_ns - t_ns * self._per[0] // self._per[1]
        self._outputs_before = self._held = None
        self._now_ns = t_ns

    def plant_time_ns(self, t_ns: int) -> int:
        """Return the plant's time at an instant of the PLC's time."""
        return self._origin_ns + t_ns * self._per[0] // self._per[1]

    def next_event_ns(self) -> int | None:
        """Return the first instant of the PLC's time at which a reading or a fact has changed."""
        if self._held is not None:
            return self._now_ns + 1
        try:
            event = self.plant.next_event_ns()
        except Exception as problem:
            raise self._failure(problem) from problem
        if event is None:
            return None
        return -((self._origin_ns - event) * self._per[1] // self._per[0])

    def checkpoint(self) -> Checkpoint:
        """Return the state of plant and coupling, to which an equal coupling can return."""
        return Checkpoint(self.plant.snapshot(), self._origin_ns, self._outputs_before,
                          self._held, self._now_ns)

    def return_to(self, point: Checkpoint) -> None:
        """Take up the state of a checkpoint."""
        self.plant.restore(point.plant)
        self._origin_ns, self._outputs_before = point.origin_ns, point.outputs
        self._held, self._now_ns = point.held, point.now_ns

    def take_outputs(self, raw: Sequence[int]) -> bool:
        """Let the actuators follow the outputs' raw values; return whether any changed."""
        if raw == self._outputs_before:
            return False
        self._outputs_before = list(raw)
        if self._delayed:
            self._held = list(raw)
        else:
            self._actuate(raw)
        return True

    def _actuate(self, raw: Sequence[int]) -> None:
        values = {p.name: p.to_value(r) for p, r in zip(self.outputs, raw, strict=True)}
        try:
            self.plant.actuate(values)
        except Exception as problem:
            raise self._failure(problem) from problem

    def advance(self, t_ns: int, at_release: bool = True) -> None:
        """Bring the plant to an instant of the PLC's time; at a release, delayed outputs act."""
        target = self._origin_ns + t_ns * self._per[0] // self._per[1]
        if target > self.plant.t_ns:
            try:
                self.plant.advance(target)
            except Exception as problem:
                raise self._failure(problem) from problem
        self._now_ns = t_ns
        if at_release and self._held is not None:
            self._actuate(self._held)
            self._held = None

    def sense(self) -> dict[str, PortValue]:
        """Return the readings of the wired sensors, in their units."""
        try:
            return self.plant.sense()
        except Exception as problem:
            raise self._failure(problem) from problem

    def give_inputs(self) -> list[int]:
        """Return the raw values of the inputs, in the order of `inputs`."""
        sensed = self.sense()
        return [self.to_raw(n, sensed[point.name]) for n, point in enumerate(self.inputs)]

    def to_raw(self, n: int, value: PortValue) -> int:
        """Return the raw value of an input, by its number, for a reading of its sensor."""
        known = self._known[n]
        raw = known.get(value)
        if raw is None:
            if len(known) >= _KNOWN_LIMIT:
                known.clear()
            raw = known[value] = self.inputs[n].to_raw(value)
        return raw

    def _failure(self, problem: Exception) -> PlantFailure:
        """Return the error of a plant's model: the class may be the user's own."""
        at = f"plant {self.plant.name} at {self.plant.t_ns / NS_PER_S:g} s"
        frames = traceback.extract_tb(problem.__traceback__)
        where = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
        return PlantFailure(f"{at}: {type(problem).__name__}: {problem}{where}")
