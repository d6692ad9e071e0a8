"""Scenarios: what comes to a run from outside, at set instants (docs/scenarios.md).

One format for faults of the plant and for writes to tags: a fault scenario, a list of inputs and a
checker's counterexample are the same kind of file, and `simulate` plays all of them.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from plant_sim.contract import Plant
from plant_sim.faults import FAULTS, FaultError, Injection, check, name_of
from plcemu.base.errors import ConfigError, PlcemuError
from plcemu.base.tags import Tag
from plcemu.base.time import NS_PER_S, DurationError, parse_duration_ns
from plcemu.base.types import Value
from plcemu.engine.resource import Resource
from plcemu.io.exchange import Exchange
from plcemu.runtime.access import TagAccess
from plcemu.runtime.config import Duration, Section, Texts, problem_text
from plcemu.runtime.yamltext import KeyPath, read_yaml_value

_FACT_TYPES: dict[type, str] = {bool: "BOOL", int: "LINT", float: "LREAL", str: "STRING"}
STEPS_LIMIT = 100_000
"""Steps that one run may have."""

PLANT = "plant."
"""What names of the plant's disturbances begin with, as its tags do."""


def _seconds(value: object) -> int:
    if isinstance(value, int | float) and not isinstance(value, bool):
        t_ns = Fraction(repr(value)) * NS_PER_S
        if t_ns.denominator == 1 and t_ns >= 0:
            return int(t_ns)
    raise ValueError("a number of seconds, 0 or more, in whole ns")


Seconds = Annotated[int, BeforeValidator(_seconds)]
Nanoseconds = Annotated[int, Field(ge=0, strict=True)]
Settings = dict[str, bool | int | float | str]


class StepSection(Section):
    """One step as it is written."""

    at: Duration | None = None
    at_s: Seconds | None = None
    t_ns: Nanoseconds | None = None
    fault: str | None = None
    target: str | None = None
    value: bool | int | float | None = None
    until: Duration | None = None
    until_s: Seconds | None = None
    until_ns: Nanoseconds | None = None
    set: Settings = Field(default_factory=dict)
    force: Settings = Field(default_factory=dict)
    unforce: Texts = Field(default_factory=list)

    @model_validator(mode="after")
    def _whole(self) -> StepSection:
        if len([t for t in (self.at, self.at_s, self.t_ns) if t is not None]) != 1:
            raise ValueError("one of at (such as 10s), at_s (10) and t_ns (10000000000)")
        ends = [t for t in (self.until, self.until_s, self.until_ns) if t is not None]
        if len(ends) > 1:
            raise ValueError("at most one of until, until_s and until_ns")
        if (self.fault is None) != (self.target is None):
            raise ValueError("fault and target together")
        if self.fault is None and (ends or self.value is not None):
            raise ValueError("value and until with a fault only")
        if self.fault is None and not (self.set or self.force or self.unforce):
            raise ValueError("a fault with its target, or set, force or unforce")
        return self


class ScenarioSection(Section):
    """A file as it is written."""

    description: str = ""
    steps: list[StepSection]


@dataclass(frozen=True, slots=True)
class Step:
    """What happens at one instant of the PLC's time.

    Attributes:
        t_ns: when.
        where: the place in a file, or the option, that says so.
        injection: a fault, its times in the PLC's time; or None.
        sets: tag or address: value to write once.
        forces: tag: value to hold.
        unforces: tags whose force ends.
    """

    t_ns: int
    where: str
    injection: Injection | None = None
    sets: tuple[tuple[str, Value], ...] = ()
    forces: tuple[tuple[str, Value], ...] = ()
    unforces: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Scenario:
    """Steps in the order of their time."""

    steps: tuple[Step, ...] = ()

    def __add__(self, other: Scenario) -> Scenario:
        return Scenario.of([*self.steps, *other.steps])

    def __bool__(self) -> bool:
        return bool(self.steps)

    @classmethod
    def of(cls, steps: Iterable[Step]) -> Scenario:
        """Return the scenario of steps in any order.

        Raises:
            ConfigError: there are too many.
        """
        ordered = tuple(sorted(steps, key=lambda step: step.t_ns))
        if len(ordered) > STEPS_LIMIT:
            raise ConfigError([f"{ordered[-1].where}: more than {STEPS_LIMIT} steps, the limit"])
        return cls(ordered)


# ---------------------------------------------------------------- reading


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ConfigError: with every mistake and its line.
    """
    file = Path(path)
    value, lines = read_yaml_value(file)
    bare = isinstance(value, list)
    if not bare and not isinstance(value, dict):
        raise ConfigError([f"{file}: expected a list of steps, or 'steps:' with such a list"])
    values: Any = {"steps": value} if bare else value
    places = {(("steps", *key) if bare else key): f"{file}:{n}" for key, n in lines.items()}
    try:
        section = ScenarioSection.model_validate(values)
    except ValidationError as problems:
        raise ConfigError([problem_text(str(file), places, p, _known)
                           for p in problems.errors()]) from None
    return Scenario.of(_step(step, places.get(("steps", str(n)), str(file)))
                       for n, step in enumerate(section.steps))


def _known(location: KeyPath) -> Iterable[str]:
    return StepSection.model_fields if len(location) > 1 else ScenarioSection.model_fields


def _step(section: StepSection, where: str) -> Step:
    t_ns = _first(section.at, section.at_s, section.t_ns)
    assert t_ns is not None
    until_ns = _first(section.until, section.until_s, section.until_ns)
    injection = None
    if section.fault is not None and section.target is not None:
        injection = Injection(t_ns, section.target, section.fault, section.value, until_ns)
    return Step(t_ns, where, injection, tuple(section.set.items()), tuple(section.force.items()),
                tuple(section.unforce))


def _first(*values: int | None) -> int | None:
    return next((v for v in values if v is not None), None)


_TIME = r"(?:L?T(?:IME)?#)?[0-9][\w. ]*?"
_FAULT = re.compile(rf"(?P<what>.+?)(?:\s+(?:at|from)\s+(?P<at>{_TIME}))?"
                    rf"(?:\s+until\s+(?P<until>{_TIME}))?", re.IGNORECASE)


def parse_fault(text: str) -> Scenario:
    """Read a fault as it is given on the command line: `V8 stuck at 100s`, `B3 leak 0.02 at 5min
    until 10min`; without `at` it is there from the start.

    Raises:
        ConfigError: it is none.
    """
    where = f"--fault {text!r}"
    match = _FAULT.fullmatch(text.strip())
    words = match["what"].split() if match else []
    value: bool | float | None = None
    if len(words) > 2 and (value := _value(words[-1])) is not None:
        words.pop()
    if match is None or len(words) < 2:
        raise ConfigError([(f"{where}: expected TARGET FAULT [VALUE] [at TIME] [until TIME], such "
                            "as 'V8 stuck at 100s'")])
    try:
        t_ns = parse_duration_ns(match["at"]) if match["at"] else 0
        until_ns = parse_duration_ns(match["until"]) if match["until"] else None
    except DurationError as problem:
        raise ConfigError([f"{where}: {problem}"]) from None
    fault = " ".join(words[1:])
    fault = name_of(fault) if name_of(fault) in FAULTS else fault
    return Scenario((Step(t_ns, where, Injection(t_ns, words[0], fault, value, until_ns)),))


def _value(word: str) -> bool | float | None:
    if word.casefold() in ("true", "false"):
        return word.casefold() == "true"
    try:
        return float(word)
    except ValueError:
        return None


def dump_scenario(steps: Iterable[tuple[int, Mapping[str, Value]]], description: str = "") -> str:
    """Write tag writes, (t_ns, values) each, as the text of a scenario file that reads back."""
    rows = [{"t_ns": t_ns, "set": dict(values)} for t_ns, values in steps]
    document = {"description": description, "steps": rows}
    return str(yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100))


# ---------------------------------------------------------------- what concerns the plant


def injections_of(scenario: Scenario, plant: Plant, scale: Fraction) -> list[Injection]:
    """Return the faults of a scenario in plant time, checked against the plant.

    `set` of a disturbance, such as `plant.condenser.malfunction`, is a fault too: it lasts until
    the disturbance is set anew.

    Raises:
        ConfigError: with every fault that the plant cannot have.
    """
    ports = {port.name: port for port in plant.ports}
    found, problems = [], list[str]()
    for step, one in _faults(scenario, plant):
        until = None if one.until_ns is None else int(one.until_ns * scale)
        try:
            found.append(check(one._replace(t_ns=int(one.t_ns * scale), until_ns=until), ports))
        except FaultError as problem:
            problems.append(f"{step.where}: {problem}")
    if problems:
        raise ConfigError(problems)
    return found


def _faults(scenario: Scenario, plant: Plant) -> list[tuple[Step, Injection]]:
    names = _disturbances(plant)
    found: list[tuple[Step, Injection]] = []
    last: dict[str, int] = {}
    for step in scenario.steps:
        if step.injection is not None:
            found.append((step, step.injection))
        for name, value in step.sets:
            port = names.get(name.casefold())
            if port is None:
                continue
            target, _, fault = port.rpartition(".")
            if port in last:  # the setting before it ends here
                at = last[port]
                found[at] = (found[at][0], found[at][1]._replace(until_ns=step.t_ns))
            if value:
                last[port] = len(found)
                number = value if isinstance(value, bool | int | float) else None
                found.append((step, Injection(step.t_ns, target, fault, number)))
            else:
                last.pop(port, None)
    return found


def _disturbances(plant: Plant | None) -> dict[str, str]:
    """Return the names by which a plant's disturbances may be set: folded name to port."""
    ports = plant.ports if plant is not None else ()
    return {f"{PLANT}{port.name}".casefold(): port.name for port in ports
            if port.direction == "disturbance"}


# ---------------------------------------------------------------- what concerns the PLC


class PlayedFacts:
    """What a scenario says of a plant that is not in this process: tags such as `plant.overflow`.

    With them a checker's counterexample is judged as it was found, without its plant.

    Args:
        scenario: which sets them; where it does not yet, they are FALSE or 0.
        known: the tags of the PLC, which are none of these.

    Raises:
        ConfigError: a fact gets values of different types.
    """

    def __init__(self, scenario: Scenario = Scenario(),
                 known: Container[str] = ()) -> None:
        types: dict[str, type] = {}
        for step in scenario.steps:
            for name, value in step.sets:
                if name.startswith(PLANT) and name not in known \
                        and types.setdefault(name, type(value)) is not type(value):
                    raise ConfigError([f"{step.where}: {name} gets values of different types"])
        self.tags = [Tag(name, _FACT_TYPES[type_], comment="as the scenario says")
                     for name, type_ in types.items()]
        self.names = tuple(types)
        self._values: tuple[Value, ...] = tuple(type_() for type_ in types.values())

    def values(self) -> Sequence[Value]:
        """The values now."""
        return self._values

    def take(self, name: str, value: Value) -> bool:
        """Take a value, if it is one of a fact."""
        if name not in self.names:
            return False
        at = self.names.index(name)
        self._values = (*self._values[:at], value, *self._values[at + 1:])
        return True


class Player:
    """Writes and forces tags of a PLC when a scenario says so.

    A step takes effect at the first lap that is not before it.

    Args:
        scenario: whose faults are left to the plant.
        resource: of the PLC.
        exchange: of the PLC.
        plant: the plant in this process, whose disturbances are no tags of the PLC.
        driven: addresses that this plant drives, which a scenario cannot write.
        facts: what the scenario says of a plant that is not here.

    Attributes:
        played: steps played so far.

    Raises:
        ConfigError: there is no such tag, it cannot have the value, or a fault has no plant.
    """

    PORT = "scenario"

    def __init__(self, scenario: Scenario, resource: Resource, exchange: Exchange,
                 plant: Plant | None = None, driven: Mapping[str, str] | None = None,
                 facts: PlayedFacts | None = None) -> None:
        self._resource = resource
        self._facts = facts or PlayedFacts()
        self._access = TagAccess(resource.memory, exchange, self.PORT)
        own = _disturbances(plant)
        if plant is None and (faults := [s for s in scenario.steps if s.injection is not None]):
            raise ConfigError([f"{step.where}: there is no plant in this process to have a fault"
                               for step in faults])
        self._steps = [(step, [(n, v) for n, v in step.sets if n.casefold() not in own])
                       for step in scenario.steps]
        self._steps = [(step, sets) for step, sets in self._steps
                       if sets or step.forces or step.unforces]
        self.played = 0
        problems = [problem for step, sets in self._steps
                    for problem in self._problems(step, sets, driven or {})]
        if problems:
            raise ConfigError(problems)

    def _problems(self, step: Step, sets: Sequence[tuple[str, Value]],
                  driven: Mapping[str, str]) -> list[str]:
        """Return what is wrong with a step: every write is tried without being made."""
        problems = []
        for name, value in (*sets, *step.forces):
            if name in self._facts.names:
                continue
            try:
                address = self._access.check(name, value)
            except PlcemuError as problem:
                problems.append(f"{step.where}: {problem}")
                continue
            if address in driven and (name, value) in sets:
                problems.append(f"{step.where}: {name} is driven by the plant's {driven[address]}: "
                                "use a fault, such as stuck with a value, or force")
        for name in step.unforces:
            try:
                self._access.read(name)
            except PlcemuError as problem:
                problems.append(f"{step.where}: {problem}")
        return problems

    def next_event_ns(self) -> int | None:
        """Return when the next step is due, if there is one."""
        return self._steps[self.played][0].t_ns if self.played < len(self._steps) else None

    def before_scan(self, t_ns: int) -> None:
        """Queue what is due at a lap."""
        while self.played < len(self._steps) and self._steps[self.played][0].t_ns <= t_ns:
            step, sets = self._steps[self.played]
            self.played += 1
            for name, value in sets:
                if not self._facts.take(name, value):
                    self._access.write(name, value)
            for name, value in step.forces:
                self._access.force(name, value)
            for name in step.unforces:
                self._access.unforce(name)
            self._resource.inputs_changed()



def refuse_tags(scenario: Scenario, plant: Plant) -> None:
    """Refuse steps that write tags, for a plant that has no PLC in its process.

    Raises:
        ConfigError: there are such steps.
    """
    own = _disturbances(plant)
    problems = [f"{step.where}: {name} is a tag of the PLC, which is not in this process; leave "
                "it to `simulate` or `run`" for step in scenario.steps
                for name in (*(n for n, _ in step.sets if n.casefold() not in own),
                             *(n for n, _ in step.forces), *step.unforces)]
    if problems:
        raise ConfigError(problems)
