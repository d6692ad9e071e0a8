"""A system: everything that one configuration describes, ready to run."""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import Any, Literal, NamedTuple

import plcemu
from plcemu.base.errors import (
    CompileError,
    ConfigError,
    PlcemuError,
)
from plcemu.base.tags import TagTable
from plcemu.engine.resource import Resource
from plcemu.io.exchange import Exchange
from plcemu.ir.program import Program
from plcemu.lang.compile import compile_program
from plcemu.modbus import (
    FAULT_OBJECT,
    RUN_OBJECT,
    STATE_OBJECT,
    Identity,
    ModbusTcpServer,
)
from plcemu.modbus.identity import OBJECT_BYTES
from plcemu.monitor import Property, load_properties
from plcemu.monitor.formula import tag_refs
from plcemu.runtime.change import Change, make_exchange
from plcemu.runtime.config import (
    Config,
)
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.local_plant import LocalPlant
from plcemu.runtime.recordings import Recordings
from plcemu.runtime.retention import Retention, default_path
from plcemu.runtime.scenario import PlayedFacts, Player, Scenario
from plcemu.runtime.wiring import (
    configured_scenario,
    make_coupling,
    make_map,
    make_reactions,
    make_resource,
)

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
        tags = TagTable(slot.tag for slot in program.layout.slots)
        self._played = PlayedFacts(scenario, tags) if self.plant is None else PlayedFacts()
        self.properties, self.not_judged = self._judged(properties, program)
        self.recordings: Recordings | None = None
        self.reactions = make_reactions(config, self.properties, self.not_judged, self._record)
        sources = [s for s in (self.retention, self.reactions.alarms, self._played)
                   if s is not None]
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
            return Player(scenario, resource, self.exchange, facts=self._played)
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
        known = TagTable([*(slot.tag for slot in program.layout.slots), *self._played.tags])
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
