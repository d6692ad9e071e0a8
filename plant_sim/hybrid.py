"""What hybrid plants share: modes, guards, timers, events, sensors, snapshots.

Between events every quantity of the plant is a function of time: a straight line (`lines.Line`)
here, other curves in `automaton`. A *mode* lasts until a guard is reached, a timer expires or an
actuator changes; then the plant *settles*: it resets quantities, chooses how they go on and notes
facts. All event instants are whole ns. A plant re-anchors its quantities only when it settles, so
`advance` between events moves nothing but the time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any, ClassVar, NamedTuple, Protocol

from plant_sim.contract import Fact, FactValue, Port, PortValue
from plant_sim.lines import NEVER_NS, Form, Line, exact, first_not_negative
from plant_sim.memory import Memory
from plant_sim.parameters import Parameters

_ZERO_TIME_LIMIT = 64
"""Settlings at one instant; more means a plant that switches for ever without time passing."""


class End(Protocol):
    """Something that ends a mode."""

    @property
    def name(self) -> str:
        """What `_settle` gets to know of it."""

    def first_ns(self, lines: Mapping[str, Any], t_ns: int) -> int:
        """The first instant from `t_ns` on at which it ends the mode, or NEVER_NS."""


class Guard(NamedTuple):
    """Ends the mode at the first ns at which `form` is not negative; a falling guard negates it."""

    name: str
    form: Form

    def first_ns(self, lines: Mapping[str, Any], t_ns: int) -> int:
        """The first instant from `t_ns` on at which the form is not negative, or NEVER_NS."""
        course = self.form.seen(lines, t_ns)
        return t_ns + first_not_negative(course.value, course.slope)


class Timer(NamedTuple):
    """Ends the mode at `t_ns`."""

    name: str
    t_ns: int


class ZenoError(RuntimeError):
    """A plant that changes its mode for ever at one instant: a mistake in the plant's model."""


class _Moment(NamedTuple):
    """All that a look ahead must put back."""

    t_ns: int
    lines: dict[str, Any]
    entry: Any
    memory: Memory
    log_length: int
    ends: list[tuple[int, str]]
    mode_end_ns: int
    counts: dict[str, int]
    values: dict[str, PortValue]
    changes: dict[str, int]
    change_ns: int
    facts: dict[str, FactValue] | None


class SensorReading(Protocol):
    """How a sensor reads the quantities of a plant, in whole resolutions."""

    @property
    def quantities(self) -> frozenset[str]:
        """Names of the quantities that the reading depends on."""

    def read(self, lines: Mapping[str, Any], t_ns: int) -> tuple[int, int]:
        """The count read at `t_ns`, and the first instant after it with another, or NEVER_NS.

        True as long as the lines stay.
        """


class HybridPlant(ABC):
    """Base of all hybrid plants; implements the plant contract.

    A plant supplies `_begin` (initial quantities), `_settle`, `_guards`, `_timers`, `_observe` and
    `report`. In `_settle` it uses `self.actuators`, `self.memory`, `_value`, `_set`, `_slope` and
    `note`; it must leave every guard of the new mode negative.
    """

    name: ClassVar[str]
    log_limit: ClassVar[int] = 100_000
    """Entries kept in the log; later ones are dropped and counted in `log_dropped`."""
    look_ahead_limit: ClassVar[int] = 10_000
    """Mode ends that show nothing through which an event is sought; then the last one is it."""

    def __init__(
        self,
        parameters: Parameters,
        ports: Sequence[Port],
        facts: Sequence[Fact],
        readings: Mapping[str, SensorReading],
    ) -> None:
        self.parameters = parameters
        self.ports = tuple(ports)
        self.facts = tuple(facts)
        self._readings = dict(readings)
        self._sources = {name: reading.quantities for name, reading in readings.items()}
        self._directions = {port.name: port.direction for port in self.ports}
        sensors = [port for port in self.ports if port.direction == "sensor"]
        self._resolutions = {
            port.name: (1, 0) if port.kind == "bool" else exact(port.resolution).as_integer_ratio()
            for port in sensors
        }
        self._watched = tuple(self._resolutions)
        self._event_ns = self._change_ns = -1
        self._facts: dict[str, FactValue] | None = None
        self._entry: Any = None
        self._ahead: tuple[_Moment, list[tuple[int, str]]] | None = None
        """Where a look ahead has found the plant right after the end of the present mode."""
        self.reset()

    # What a plant supplies

    @abstractmethod
    def _begin(self) -> dict[str, Any]:
        """Initial value of every quantity; of a line in quanta."""

    @abstractmethod
    def _settle(self, fired: frozenset[str]) -> None:
        """Discrete part of the plant at the present instant.

        `fired` names the guards and timers that ended the mode; it is empty after a change of
        actuators and at the start.
        """

    @abstractmethod
    def _guards(self) -> Iterable[End]:
        """The guards of the present mode."""

    def _timers(self) -> Iterable[Timer]:
        """The timers that run in the present mode."""
        return ()

    @abstractmethod
    def _observe(self) -> dict[str, FactValue]:
        """Values of all facts, which only settling changes."""

    @abstractmethod
    def report(self) -> dict[str, Any]:
        """Summary of the run so far, ready for JSON."""

    def _value(self, quantity: str) -> int:
        value: int = self._lines[quantity].at(self._t_ns)
        return value

    def _set(self, quantity: str, value: int) -> None:
        self._put(quantity, self._lines[quantity].with_value(value, self._t_ns))

    def _slope(self, quantity: str, slope: Fraction) -> None:
        line = self._lines[quantity]
        if (line.num, line.den) != slope.as_integer_ratio():
            self._put(quantity, line.with_slope(slope, self._t_ns))

    def _put(self, quantity: str, line: Line) -> None:
        if line is not self._lines[quantity]:
            self._lines[quantity] = line
            self._moved.add(quantity)

    def _rises(self, quantity: str) -> int:
        """An integer with the sign of the quantity's slope."""
        slope: int = self._lines[quantity].num
        return slope

    def note(self, entry: str) -> None:
        """Add an entry to the log, as long as `log_limit` allows."""
        if len(self.log) < self.log_limit:
            self.log.append((self._t_ns, entry))
        else:
            self.memory.numbers["log_dropped"] += 1

    # The contract

    @property
    def t_ns(self) -> int:
        """Plant time in ns since `reset`."""
        return self._t_ns

    def reset(self) -> None:
        """Back to the initial state at `t_ns == 0`, all actuators off; what is watched stays."""
        self._t_ns = 0
        self.actuators: dict[str, PortValue] = {
            port.name: False if port.kind == "bool" else port.low
            for port in self.ports
            if port.direction != "sensor"
        }
        self.memory = Memory()
        self.memory.numbers["log_dropped"] = 0
        self.log: list[tuple[int, str]] = []
        self._moved: set[str] = set()
        self._lines: dict[str, Any] = self._first_lines()
        self._forget_readings()
        self._enter_mode(frozenset())
        self._run_events_until(0)

    def actuate(self, values: Mapping[str, PortValue]) -> None:
        """Set the named actuators together; raises ValueError for a name that is none."""
        self._drive(values, "actuator")

    def disturb(self, values: Mapping[str, PortValue]) -> None:
        """Set the named disturbances together; raises ValueError for a name that is none."""
        self._drive(values, "disturbance")

    def _drive(self, values: Mapping[str, PortValue], direction: str) -> None:
        actuators, directions = self.actuators, self._directions
        changed = False
        for name, value in values.items():
            if directions.get(name) != direction:
                raise ValueError(f"{self.name} has no {direction} {name}")
            changed = changed or actuators[name] != value
        if changed:
            actuators.update(
                (name, bool(value) if isinstance(actuators[name], bool) else float(value))
                for name, value in values.items()
            )
            self._enter_mode(frozenset())
            self._run_events_until(self._t_ns)

    def advance(self, t_ns: int) -> None:
        """Move to exactly `t_ns`. Raises ValueError if that is in the past."""
        if t_ns < self._t_ns:
            raise ValueError(f"{self.name} is at {self._t_ns} ns, cannot go back to {t_ns} ns")
        if t_ns >= self._mode_end_ns:
            self._run_events_until(t_ns)
        self._t_ns = t_ns

    def sense(self) -> dict[str, PortValue]:
        """Present readings of the watched sensors, in their units."""
        self._read()
        return dict(self._values)

    def counts(self) -> dict[str, int]:
        """Present readings of the watched sensors, in whole resolutions."""
        self._read()
        return dict(self._counts)

    def observe(self) -> dict[str, FactValue]:
        """Present values of all facts, to be read only."""
        if self._facts is None:
            self._facts = self._observe()
        return self._facts

    def watch(self, names: Iterable[str] | None = None) -> None:
        """Let only these sensors cause events and appear in `sense`; None means all."""
        chosen = tuple(self._resolutions) if names is None else tuple(dict.fromkeys(names))
        for name in chosen:
            if name not in self._resolutions:
                raise ValueError(f"{self.name} has no sensor {name}")
        self._watched = chosen
        self._forget_readings()

    def next_event_ns(self) -> int | None:
        """Earliest instant after now at which a watched reading or a fact changes."""
        if self._moved or self._t_ns >= self._change_ns:
            self._read()
        if self._event_ns <= self._t_ns:
            self._event_ns = self._look_for_event()
        return self._event_ns if self._event_ns < NEVER_NS else None

    def snapshot(self) -> dict[str, Any]:
        """The complete state, ready for JSON."""
        return {
            "plant": self.name,
            "parameters": self.parameters.as_dict(),
            "t_ns": self._t_ns,
            "actuators": dict(self.actuators),
            "watched": list(self._watched),
            "lines": self._lines_image(),
            "memory": self.memory.to_json(),
            "log": [list(entry) for entry in self.log],
        }

    def restore(self, image: Mapping[str, Any]) -> None:
        """Continue from a snapshot; raises ValueError for one of another plant."""
        if (image["plant"], image["parameters"]) != (self.name, self.parameters.as_dict()):
            raise ValueError(f"the snapshot is not of this {self.name} and its parameters")
        self._t_ns = image["t_ns"]
        self.actuators = dict(image["actuators"])
        self._restore_lines(image["lines"])
        self.memory = Memory.from_json(image["memory"])
        self.log = [(t_ns, entry) for t_ns, entry in image["log"]]
        self.watch(image["watched"])
        self._arm()

    # How quantities are kept

    def _first_lines(self) -> dict[str, Any]:
        return {name: Line(value) for name, value in self._begin().items()}

    def _lines_image(self) -> Any:
        return {name: list(line) for name, line in self._lines.items()}

    def _restore_lines(self, image: Any) -> None:
        self._lines = {name: Line(*line) for name, line in image.items()}

    # Modes and events

    def _enter_mode(self, fired: frozenset[str]) -> None:
        self._event_ns = -1
        self._ahead = self._facts = None
        self._settle(fired)
        self._arm()

    def _arm(self) -> None:
        t_ns, lines = self._t_ns, self._lines
        ends = [(guard.first_ns(lines, t_ns), guard.name) for guard in self._guards()]
        ends += [(timer.t_ns, timer.name) for timer in self._timers()]
        self._mode_ends = ends
        self._mode_end_ns = min(ends)[0] if ends else NEVER_NS

    def _run_events_until(self, t_ns: int) -> None:
        if self._ahead is not None and self._mode_end_ns <= t_ns:
            (moment, entries), self._ahead = self._ahead, None
            self._put_back(moment)
            self.log += entries
            self._event_ns = -1
        steps = 0
        while self._mode_end_ns <= t_ns:
            steps = steps + 1 if self._mode_end_ns == self._t_ns else 0
            if steps > _ZERO_TIME_LIMIT:
                raise ZenoError(f"{self.name} never settles at {self._t_ns} ns")
            self._step()

    def _step(self) -> None:
        """Go to the end of the present mode and into the next."""
        t_ns = self._t_ns = self._mode_end_ns
        self._enter_mode(frozenset(name for end_ns, name in self._mode_ends if end_ns <= t_ns))

    # Readings

    def _forget_readings(self) -> None:
        self._ahead = self._facts = None
        self._counts = dict.fromkeys(self._watched, 0)
        self._values: dict[str, PortValue] = dict.fromkeys(self._watched, 0.0)
        self._changes = dict.fromkeys(self._watched, -1)
        self._change_ns = -1
        self._event_ns = -1

    def _read(self) -> None:
        """Bring the counts of the watched sensors up to the present instant."""
        if self._t_ns < self._change_ns and not self._moved:
            return
        t_ns, lines, moved, changes = self._t_ns, self._lines, self._moved, self._changes
        due = [name for name, change_ns in changes.items() if change_ns <= t_ns]
        if moved:
            due += [name for name in changes if not moved.isdisjoint(self._sources[name])]
            moved.clear()
        for name in due:
            count, changes[name] = self._readings[name].read(lines, t_ns)
            self._counts[name] = count
            top, bottom = self._resolutions[name]
            self._values[name] = bool(count) if not bottom else count * top / bottom
        self._change_ns = min(changes.values(), default=NEVER_NS)

    def _look_for_event(self) -> int:
        """The next visible change, looking through mode ends that show nothing."""
        if self._change_ns < self._mode_end_ns:
            return self._change_ns
        moment = self._keep()
        event_ns = self._seek_event(moment.counts, self.observe())
        if self._t_ns == moment.mode_end_ns:
            self._ahead = self._keep(), self.log[moment.log_length :]
        self._put_back(moment)
        return event_ns

    def _seek_event(self, counts: dict[str, int], facts: dict[str, FactValue]) -> int:
        """Run on until other counts are read or other facts hold; moves the plant."""
        for _ in range(self.look_ahead_limit):
            if self._change_ns < self._mode_end_ns or self._mode_end_ns == NEVER_NS:
                return self._change_ns
            self._step()
            self._run_events_until(self._t_ns)
            self._read()
            if self._counts != counts or self.observe() != facts:
                break
        return self._t_ns

    def _keep(self) -> _Moment:
        return _Moment(
            self._t_ns,
            dict(self._lines),
            self._entry,
            self.memory.copy(),
            len(self.log),
            self._mode_ends,
            self._mode_end_ns,
            dict(self._counts),
            dict(self._values),
            dict(self._changes),
            self._change_ns,
            self._facts,
        )

    def _put_back(self, moment: _Moment) -> None:
        self._t_ns, self._lines, self.memory = moment.t_ns, moment.lines, moment.memory
        self._entry = moment.entry
        del self.log[moment.log_length :]  # of a moment ahead there is nothing to take away
        self._mode_ends, self._mode_end_ns = moment.ends, moment.mode_end_ns
        self._counts, self._values = moment.counts, moment.values
        self._changes = moment.changes
        self._change_ns = moment.change_ns
        self._facts = moment.facts
        self._moved.clear()

