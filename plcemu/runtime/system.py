"""Wiring: a configuration becomes a PLC with its plant, monitors and server, ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import plcemu
from hil.coupling import Coupling, points
from plant_sim.contract import Plant
from plant_sim.parameters import ParameterError
from plant_sim.registry import PlantLoadError, load
from plcemu.base.errors import ConfigError, PlcemuError
from plcemu.engine.resource import Resource
from plcemu.io.exchange import Exchange
from plcemu.ir.program import Task
from plcemu.lang.compile import compile_program
from plcemu.modbus import AddressMap, Identity, MapRange, ModbusTcpServer
from plcemu.monitor import Property, load_properties
from plcemu.monitor.formula import tag_refs
from plcemu.runtime.config import Config, InputSection, PlantSection
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.local_plant import LocalPlant
from plcemu.runtime.plc import make_exchange


class System:
    """Everything that one configuration describes.

    Attributes:
        config: as read.
        resource: the PLC's processor.
        exchange: its process image.
        cycle: its laps, with plant and monitors.
        plant: the plant in this process, or None.

    Args:
        config: the configuration.
        with_plant: whether the configured plant runs in this process.

    Raises:
        CompileError: the program or a property is wrong.
        ConfigError: the plant, its wiring, a task or an output does not exist.
    """

    def __init__(self, config: Config, with_plant: bool = True) -> None:
        self.config = config
        program = compile_program(config.program_paths, final_scan=config.sfc_final_scan)
        self.warnings = list(program.warnings)
        tasks = [Task(name, t.interval, t.priority, t.phase, tuple(t.programs))
                 for name, t in config.tasks.items()]
        try:
            self.resource = Resource(program, config.cycle, config.engine, tasks or None,
                                     config.safe_outputs)
        except (PlcemuError, ValueError) as problem:
            raise ConfigError([str(problem)]) from None
        self.exchange: Exchange = make_exchange(self.resource)
        self.plant: LocalPlant | None = None
        if config.plant is not None and with_plant:
            self.plant = LocalPlant(make_coupling(config.plant), self.exchange)
        self.properties: list[Property] = [
            p for path in config.property_paths for p in load_properties(path)]
        if self.plant is None:
            self.properties = [p for p in self.properties if not _speaks_of_plant(p)]
        self.cycle = Cycle(self.resource, self.exchange, self.plant, self.properties)

    def server(self) -> ModbusTcpServer:
        """Return the configured Modbus server, not yet listening."""
        section = self.config.modbus
        try:
            address_map = make_map(self.config)
        except ValueError as problem:
            raise ConfigError([f"modbus.ranges: {problem}"]) from None
        identity = Identity(revision=plcemu.__version__, product_name="plcemu PLC runtime emulator",
                            application_name=self.config.name)
        return ModbusTcpServer(
            self.exchange, address_map, identity, host=section.host, port=section.port,
            units=section.units, max_connections=section.max_connections,
            idle_timeout_s=section.idle_timeout / 1e9, budget=section.requests_per_scan)

    def report(self) -> dict[str, Any]:
        """Return how things stand as plain values, with the keys of docs (interface of `simulate`)."""
        counters = self.cycle.counters
        document: dict[str, Any] = {
            "name": self.config.name,
            "state": self.resource.state.value,
            "t_s": self.cycle.t_ns / 1e9,
            "scans": self.cycle.scan_number,
            "executed": counters.laps,
            "overruns": counters.overruns,
            "missed": counters.missed,
            "properties": [r.as_json() for r in self.cycle.suite.results()],
            "tags": {tag.name: self.resource.memory.read(i)
                     for i, tag in enumerate(self.resource.memory.tags)},
        }
        if self.resource.fault is not None:
            document["fault"] = str(self.resource.fault)
        if self.plant is not None:
            document["plant"] = self.plant.coupling.plant.report()
        return document


def make_map(config: Config) -> AddressMap:
    """Return the Modbus map of a configuration; raises ValueError for ranges that do not fit."""
    section = config.modbus
    if section.ranges is None:
        return AddressMap(field_window=section.field_window)
    ranges = [MapRange(r.type, r.first, r.count, r.area.upper(), r.element,
                       "rw" if r.access == "rw" else "r", r.field_window)
              for r in section.ranges]
    return AddressMap(ranges, field_window=section.field_window)


def make_plant(section: PlantSection) -> Plant:
    """Return the configured plant.

    Raises:
        ConfigError: there is no such plant or parameter, or a value does not fit.
    """
    try:
        return load(section.model, section.parameters)
    except PlantLoadError as problem:
        raise ConfigError([f"plant.model: {problem}"]) from None
    except ParameterError as problem:
        raise ConfigError([f"plant.parameters: {problem}"]) from None


def make_coupling(section: PlantSection, state: Mapping[str, Any] | None = None) -> Coupling:
    """Return the configured plant with its wiring, perhaps in a state it had before.

    Raises:
        ConfigError: the plant or its wiring does not exist, or the state is another plant's.
    """
    plant = make_plant(section)
    if state is not None:
        try:
            plant.restore(state)
        except (ValueError, KeyError, TypeError) as problem:
            raise ConfigError([f"the plant's saved state does not fit: {problem}; "
                               "--fresh starts anew"]) from None
    sensors = [p.name for p in plant.ports if p.direction == "sensor"]
    actuators = [p.name for p in plant.ports if p.direction == "actuator"]
    try:
        inputs = points(_wiring(section.inputs), sensors, "inputs")
        outputs = points(_wiring(section.outputs), actuators, "outputs")
    except PlcemuError as problem:
        raise ConfigError([str(problem)]) from None
    return Coupling(plant, inputs, outputs, section.time_scale)


def _wiring(section: Mapping[str, InputSection]) -> dict[str, tuple[str, Fraction]]:
    return {name: (point.address, point.scale) for name, point in section.items()}


def _speaks_of_plant(entry: Property) -> bool:
    """Whether a property names a fact of the plant, which is not known without the plant."""
    return any(ref.name.casefold().startswith("plant.") for ref in tag_refs(entry.formula))
