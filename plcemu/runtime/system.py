"""Wiring: a configuration becomes a PLC with its plant, monitors and server, ready to run."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import plcemu
from hil.coupling import Coupling, CouplingError, points
from plant_sim.contract import Plant, Port
from plant_sim.parameters import ParameterError
from plant_sim.registry import PlantLoadError, load
from plant_sim.rig import Rig
from plcemu.base.errors import (
    CompileError,
    ConfigError,
    PlcemuError,
    UnknownNameError,
    did_you_mean,
)
from plcemu.base.tags import TagTable
from plcemu.base.types import ELEMENTARY
from plcemu.engine.engines import ENGINES
from plcemu.engine.jitter import Jitter
from plcemu.engine.resource import Resource
from plcemu.io.exchange import Exchange
from plcemu.io.mapping import Point
from plcemu.ir.program import Program, Task
from plcemu.lang.compile import compile_program
from plcemu.modbus import (
    FAULT_OBJECT,
    RUN_OBJECT,
    STATE_OBJECT,
    AddressMap,
    Identity,
    MapRange,
    ModbusTcpServer,
    ObjectType,
)
from plcemu.modbus.identity import OBJECT_BYTES
from plcemu.monitor import Property, load_properties
from plcemu.monitor.formula import tag_refs
from plcemu.runtime.alarms import Alarm
from plcemu.runtime.change import Change, make_exchange
from plcemu.runtime.config import (
    AlarmSection,
    Config,
    PlantSection,
    PointSection,
    TaskSection,
    plant_parameters,
)
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.local_plant import LocalPlant
from plcemu.runtime.reactions import Reaction, Reactions
from plcemu.runtime.recordings import Recordings, check_pattern
from plcemu.runtime.retention import Retention, default_path
from plcemu.runtime.scenario import Player, Scenario, injections_of, load_scenario

CHANGEABLE = ("program", "cycle", "engine", "sfc_final_scan", "sipn_single_firing", "budget",
              "watchdog", "tasks", "safe_outputs", "properties")
"""Keys that an online change takes from the configuration."""


class Parts(NamedTuple):
    """What of a system is the same for all runs of one program: compiled program, properties."""

    program: Program
    properties: list[Property]


def load_parts(config: Config) -> Parts:
    """Compile the program and read the properties of a configuration.

    Raises:
        CompileError: the program or a property is wrong.
        ConfigError: a file of properties cannot be read.
    """
    program = compile_program(config.program_paths, final_scan=config.sfc_final_scan,
                              single_firing=config.sipn_single_firing)
    return Parts(program, _load_properties(config))


class System:
    """Everything that one configuration describes.

    Attributes:
        config: as read.
        exchange: its process image.
        cycle: its laps, with plant and monitors.
        plant: the plant in this process, or None.
        scenario: what comes from outside in the run.

    Args:
        config: the configuration.
        with_plant: whether the configured plant runs in this process.
        retain: `warm` takes the retained variables over and keeps them, `cold` only keeps them,
            `off` does neither.
        scenario: what comes from outside, besides the scenario of the configuration.
        parts: program and properties, if they are loaded already.

    Raises:
        CompileError: the program or a property is wrong.
        ConfigError: the plant, its wiring, a task or an output does not exist.
    """

    def __init__(self, config: Config, with_plant: bool = True,
                 retain: Literal["off", "cold", "warm"] = "off",
                 scenario: Scenario = Scenario(),  # noqa: B008
                 parts: Parts | None = None) -> None:
        self.config = config
        program, properties = parts or load_parts(config)
        self.warnings = list(program.warnings)
        resource = make_resource(config, program)
        self.retention: Retention | None = None
        if retain != "off" and config.retain.enabled:
            path = config.retain.file
            self.retention = Retention(Path(path) if path else default_path(config.file_path),
                                       config.retain.interval, resource, retain == "cold")
        self.exchange: Exchange = make_exchange(resource)
        self._map = make_map(config)
        scenario = configured_scenario(config) + scenario
        plant = LocalPlant(make_coupling(config, scenario), self.exchange) if config.plant else None
        self.plant = plant if with_plant else None
        self._facts = TagTable(plant.tags) if plant is not None and self.plant is None \
            else TagTable()
        self.properties, self.not_judged = self._judged(properties, program)
        self.recordings: Recordings | None = None
        self.reactions = make_reactions(config, self.properties, self.not_judged, self._record)
        sources = [s for s in (self.retention, self.reactions.alarms) if s is not None]
        try:
            self.cycle = Cycle(resource, self.exchange, self.plant, self.properties, sources)
        except CompileError:
            raise
        except PlcemuError as problem:
            raise ConfigError([str(problem)]) from None
        self._join_reactions()
        self.scenario = scenario
        self.cycle.player = self._player(resource)

    def _join_reactions(self) -> None:
        config, cycle = self.config, self.cycle
        try:
            self.reactions.join(cycle)
        except PlcemuError as problem:
            raise config.mistake(("reactions",), problem) from None
        records = [r.record for r in config.reactions.values() if r.record is not None]
        if records:
            self.recordings = Recordings(lambda: cycle.tags, max(r.before for r in records),
                                         config.historian.ring)
            cycle.observers.append(self.recordings)

    def _record(self, name: str, t_ns: int) -> None:
        """Begin the recording that a reaction asks for."""
        record = self.config.reactions[name].record
        if self.recordings in self.cycle.observers and self.recordings is not None \
                and record is not None:
            self.recordings.start(name, t_ns, record.before, record.after, record.file)

    def close(self) -> None:
        """End the recordings that go on; the run is over."""
        if self.recordings is not None:
            self.recordings.close()

    def _player(self, resource: Resource) -> Player | None:
        """Return what plays the scenario on a resource, if there is one."""
        scenario = self.scenario
        if not scenario:
            return None
        if self.plant is None:
            return Player(scenario, resource, self.exchange)
        coupling = self.plant.coupling
        driven = {str(point.address): point.name for point in coupling.inputs}
        return Player(scenario, resource, self.exchange, coupling.plant, driven)

    @property
    def resource(self) -> Resource:
        """The PLC's processor; an online change puts another in its place."""
        return self.cycle.resource

    def _judged(self, properties: list[Property],
                program: Program) -> tuple[list[Property], list[str]]:
        """Return the properties, and the names of those that speak of a plant not here."""
        known = TagTable(slot.tag for slot in program.layout.slots)
        absent = [p.name for p in properties
                  if any(ref.name in self._facts and ref.name not in known
                         for ref in tag_refs(p.formula))]
        return [p for p in properties if p.name not in absent], absent

    def prepare_change(self, config: Config) -> Change:
        """Compile another version of the configuration's program; nothing changes yet.

        May be called in a thread of its own. What else differs in the configuration is told by
        `fixed_keys`, and waits for the next start.

        Raises:
            CompileError: the program or a property is wrong.
            ConfigError: tasks or outputs do not fit the program.
        """
        program, given = load_parts(config)
        resource = make_resource(config, program)
        properties, _ = self._judged(given, program)
        try:
            return Change(self.cycle, resource, properties, self._player(resource))
        except CompileError:
            raise
        except PlcemuError as problem:
            raise ConfigError([str(problem)]) from None

    def changed(self, config: Config) -> None:
        """Take over what an applied change took from its configuration."""
        self.config = self.config.model_copy(
            update={key: getattr(config, key) for key in CHANGEABLE})
        self.properties = list(self.cycle.suite.properties)
        if self.retention is not None:
            self.retention.changed(self.resource)

    def fixed_keys(self, config: Config) -> list[str]:
        """Return the keys that differ from what runs and that only a start can change."""
        return [key for key in Config.model_fields if key not in CHANGEABLE
                and getattr(config, key) != getattr(self.config, key)]

    def server(self) -> ModbusTcpServer:
        """Return the configured Modbus server, not yet listening."""
        section = self.config.modbus
        # Identification objects are ASCII of bounded length; a name need not be.
        name = self.config.name.encode("ascii", "replace").decode()[:OBJECT_BYTES]
        identity = Identity(
            revision=plcemu.__version__, product_name="plcemu PLC runtime emulator",
            application_name=name,
            extended={RUN_OBJECT: uuid.uuid4().hex,
                      STATE_OBJECT: lambda: self.resource.state.value,
                      FAULT_OBJECT: lambda: str(self.resource.fault or "")})
        return ModbusTcpServer(
            self.exchange, self._map, identity, host=section.host, port=section.port,
            units=section.units, max_connections=section.max_connections,
            idle_timeout_s=section.idle_timeout / 1e9, budget=section.requests_per_scan)

    def report(self) -> dict[str, Any]:
        """Return how things stand as plain values; the keys are those of `simulate --json`."""
        counters = self.cycle.counters
        document: dict[str, Any] = {
            "name": self.config.name,
            "state": self.resource.state.value,
            "t_s": self.cycle.now_ns / 1e9,
            "scans": self.cycle.scan_number,
            "executed": counters.laps,
            "overruns": counters.overruns,
            "missed": counters.missed,
            "properties": [r.as_json() for r in self.cycle.suite.results()],
            "tags": {tag.name: value for tag, value in
                     zip(self.cycle.tags, self.cycle.values(), strict=True)},
        }
        if self.retention is not None:
            document["retain"] = self.retention.report()
        alarms = [alarm.as_json() for alarm in self.reactions.alarms]
        if alarms:
            document["alarms"] = alarms
        if self.not_judged:
            document["not_judged"] = self.not_judged
        if self.resource.fault is not None:
            document["fault"] = str(self.resource.fault)
        if self.plant is not None:
            document["plant"] = self.plant.coupling.plant.report()
        return document


def _load_properties(config: Config) -> list[Property]:
    try:
        return [p for path in config.property_paths for p in load_properties(path)]
    except OSError as problem:
        raise config.mistake(("properties",), f"{problem.filename}: {problem.strerror}") from None


def make_reactions(config: Config, properties: Sequence[Property], not_judged: Sequence[str],
                   record: Callable[[str, int], None]) -> Reactions:
    """Return the configured reactions; those to properties that are not judged here stay out.

    Args:
        config: the configuration.
        properties: that are judged.
        not_judged: names of those that are not.
        record: begins a recording of a property's name at an instant.

    Raises:
        ConfigError: there is no such property, or a recording cannot be made.
    """
    by_name = {p.name: p for p in properties}
    made = []
    for name, section in config.reactions.items():
        if name in not_judged:
            continue
        if name not in by_name:
            raise config.mistake(("reactions", name), f"there is no property {name!r}"
                                 f"{did_you_mean(name, by_name)}")
        if section.record is not None:
            try:
                check_pattern(section.record.file)
            except ValueError as problem:
                raise config.mistake(("reactions", name, "record", "file"), problem) from None
        alarm = section.alarm
        if alarm is None and section.stop:
            alarm = AlarmSection(severity="critical")
        made.append(Reaction(
            name, section.set, section.stop,
            None if alarm is None else Alarm(name, alarm.severity,
                                             alarm.text or by_name[name].description or name),
            None if section.record is None else record))
    return Reactions(made)


def make_resource(config: Config, program: Program) -> Resource:
    """Return the resource with the configured tasks and safe outputs.

    Raises:
        ConfigError: a task, its programs or a safe output does not fit the program.
    """
    tasks = make_tasks(config, program)
    _check_safe_outputs(config, program)
    try:
        return Resource(program, config.cycle, config.engine, tasks, config.safe_outputs,
                        config.budget, _jitter(config))
    except (PlcemuError, ValueError) as problem:
        key = "engine" if config.engine not in ENGINES else "tasks"
        raise config.mistake((key,), problem) from None


def _jitter(config: Config) -> Jitter | None:
    section = config.jitter
    if section is None:
        return None
    return Jitter(section.deviation, section.per == "run", config.seed)


def make_tasks(config: Config, program: Program) -> list[Task]:
    """Return the tasks of a program as configured.

    Tasks with programs take the place of the program's own; the others change its own.

    Raises:
        ConfigError: a program is in no task or in several, or a task does not exist.
    """
    new = {name for name, section in config.tasks.items() if section.programs is not None}
    tasks = {name.casefold(): Task(name) for name in new} if new else \
        {task.name.casefold(): task for task in program.tasks}
    if len({name.casefold() for name in config.tasks}) < len(config.tasks):
        raise config.mistake(("tasks",), "two tasks have one name (case does not count)")
    for name, section in config.tasks.items():
        if name.casefold() not in tasks:
            known = ", ".join(task.name for task in tasks.values())
            raise config.mistake(("tasks", name), f"names no programs, and is no task of the "
                                 f"program text; there is {known}")
        if name in new and section.interval is None:
            raise config.mistake(("tasks", name, "interval"), "is missing")
        tasks[name.casefold()] = _configured(tasks[name.casefold()], section)
    if new:
        _check_programs(config, program, tasks.values())
    watchdog = config.watchdog or 0
    return [replace(task, watchdog_ns=task.watchdog_ns or watchdog) for task in tasks.values()]


def _configured(task: Task, section: TaskSection) -> Task:
    given: dict[str, Any] = {
        "interval_ns": section.interval, "priority": section.priority,
        "phase_ns": section.phase, "budget": section.budget, "watchdog_ns": section.watchdog,
        "programs": tuple(section.programs) if section.programs is not None else None}
    return replace(task, **{key: value for key, value in given.items() if value is not None})


def _check_programs(config: Config, program: Program, tasks: Iterable[Task]) -> None:
    """Demand that each program is in exactly one task: else it never runs, or runs too often."""
    placed = [name.casefold() for task in tasks for name in task.programs]
    for instance in program.instances:
        count = placed.count(instance.name.casefold())
        if count != 1:
            raise config.mistake(("tasks",), f"found program {instance.name} in "
                                 f"{count or 'no'} tasks, expected it in one")


def _check_safe_outputs(config: Config, program: Program) -> None:
    tags = TagTable(slot.tag for slot in program.layout.slots)
    for name, value in config.safe_outputs.items():
        path = ("safe_outputs", name)
        try:
            tag = tags[name]
            ELEMENTARY[tag.type].pack(value)
        except (UnknownNameError, ValueError) as problem:
            raise config.mistake(path, problem) from None
        if not tag.address.startswith("%Q"):
            raise config.mistake(path, f"found a variable at {tag.address or 'no address'}, "
                                 "expected an output (%Q)")


def make_map(config: Config) -> AddressMap:
    """Return the Modbus map of a configuration.

    Raises:
        ConfigError: ranges do not fit.
    """
    section = config.modbus
    if section.ranges is None:
        return AddressMap(field_window=section.field_window)
    ranges = []
    for n, r in enumerate(section.ranges):
        try:
            ranges.append(MapRange(ObjectType(r.type), r.first, r.count, r.area.upper(), r.element,
                                   r.access, r.field_window))
        except ValueError as problem:
            raise config.mistake(("modbus", "ranges", str(n)), problem) from None
    try:
        return AddressMap(ranges, field_window=section.field_window)
    except ValueError as problem:
        raise config.mistake(("modbus", "ranges"), problem) from None


def configured_scenario(config: Config) -> Scenario:
    """Return the scenario that a configuration names, or an empty one.

    Raises:
        ConfigError: the file is wrong.
    """
    if config.plant is None or config.plant.scenario is None:
        return Scenario()
    return load_scenario(config.plant.scenario)


def make_plant(config: Config, scenario: Scenario = Scenario()) -> Plant:  # noqa: B008
    """Return the configured plant with its devices, and the faults of a scenario to come.

    Raises:
        ConfigError: there is no such plant, parameter, port or fault, or a value does not fit.
    """
    section = config.plant
    if section is None:
        raise config.mistake(("plant",), "is missing")
    plant = _load_plant(config, section)
    injections = injections_of(scenario, plant, section.time_scale)
    if not (section.devices or injections):
        return plant
    devices = {name: device.device() for name, device in section.devices.items()}
    try:
        return Rig(plant, devices, injections,
                   config.seed if section.seed is None else section.seed)
    except ValueError as problem:
        raise config.mistake(("plant", "devices"), problem) from None


def _load_plant(config: Config, section: PlantSection) -> Plant:
    try:
        return load(section.model, _parameters(config, section))
    except PlantLoadError as problem:
        raise config.mistake(("plant", "model"), problem) from None
    except ParameterError as problem:
        raise config.mistake(("plant", "parameters", problem.name),
                             f"found {problem.found!r}, expected {problem.expected}") from None
    except Exception as problem:  # whatever a user's own class raises
        raise config.mistake(("plant", "model"), f"cannot be made: {type(problem).__name__}: "
                             f"{problem}") from problem


def _parameters(config: Config, section: PlantSection) -> dict[str, Any]:
    """Return the plant's parameters; a plant that draws by a seed takes the configuration's."""
    if "seed" not in plant_parameters(section.model):
        return section.parameters
    seed = config.seed if section.seed is None else section.seed
    return {"seed": seed, **section.parameters}


def make_coupling(config: Config, scenario: Scenario = Scenario()) -> Coupling:  # noqa: B008
    """Return the configured plant with its wiring, and the faults of a scenario to come.

    Raises:
        ConfigError: the plant or its wiring does not exist.
    """
    plant = make_plant(config, scenario)
    section = config.plant
    assert section is not None
    ports = plant.ports
    inputs = _points(config, section.inputs, "inputs",
                     [p for p in ports if p.direction == "sensor"])
    outputs = _points(config, section.outputs, "outputs",
                      [p for p in ports if p.direction == "actuator"])
    return Coupling(plant, inputs, outputs, section.time_scale, section.output_delay == "cycle")


def _points(config: Config, section: Mapping[str, PointSection], what: str,
            ports: Sequence[Port]) -> list[Point]:
    wiring = {name: (point.address, point.scale) for name, point in section.items()}
    try:
        return points(wiring, [port.name for port in ports])
    except CouplingError as problem:
        raise config.mistake(("plant", what, problem.name), problem) from None
