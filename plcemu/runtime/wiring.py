"""Wiring: each section of a configuration becomes the part that it describes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from hil.coupling import Coupling, CouplingError, points
from plant_sim.contract import Plant, Port
from plant_sim.parameters import ParameterError
from plant_sim.registry import PlantLoadError, load
from plant_sim.rig import Rig
from plcemu.base.errors import (
    PlcemuError,
    UnknownNameError,
    did_you_mean,
)
from plcemu.base.tags import TagTable
from plcemu.base.types import ELEMENTARY
from plcemu.engine.engines import ENGINES
from plcemu.engine.jitter import Jitter
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.ir.program import Program, Task
from plcemu.modbus import (
    AddressMap,
    MapRange,
    ObjectType,
)
from plcemu.monitor import Property
from plcemu.runtime.alarms import Alarm
from plcemu.runtime.config import (
    AlarmSection,
    Config,
    PlantSection,
    PointSection,
    TaskSection,
    plant_parameters,
)
from plcemu.runtime.reactions import Reaction, Reactions
from plcemu.runtime.recordings import check_pattern
from plcemu.runtime.scenario import Scenario, injections_of, load_scenario


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
