"""What `plcemu control` can ask of a daemon: a table of commands, each done between two scans."""

from __future__ import annotations

import os
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from plcemu import __version__
from plcemu.base.errors import PlcemuError, UnknownNameError, did_you_mean
from plcemu.base.types import StringType, Value, type_of
from plcemu.engine.resource import State
from plcemu.runtime.access import TagAccess
from plcemu.runtime.alarms import AlarmState

if TYPE_CHECKING:
    from plcemu.runtime.daemon import Daemon

Answer = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Command:
    """One command.

    Attributes:
        summary: what it does.
        arguments: names of its arguments, all texts, all needed.
        options: what each option may be, the first the default.
        takes_effect: whether the answer waits for the scan after it.
    """

    summary: str
    arguments: tuple[str, ...] = ()
    options: tuple[tuple[str, tuple[str, ...]], ...] = ()
    takes_effect: bool = True


COMMANDS: dict[str, Command] = {
    "status": Command("how the PLC stands", takes_effect=False),
    "get": Command("the value of a tag or an address", ("name",), takes_effect=False),
    "set": Command("write a value once, as a client does", ("name", "value")),
    "force": Command("hold a tag at a value, whoever else writes it", ("name", "value")),
    "unforce": Command("end a tag's force", ("name",)),
    "stop": Command("go to STOP: nothing runs, outputs take their safe values"),
    "start": Command("go to RUN with memory as it is"),
    "restart": Command("begin anew; warm keeps the retained variables, cold nothing",
                       options=(("mode", ("warm", "cold")),)),
    "alarms": Command("the alarms that are not normal", takes_effect=False),
    "ack": Command("acknowledge an alarm; its property is judged anew", ("name",)),
    "reload": Command("load the program anew and go on with it (online change)",
                      takes_effect=False),
    "commit": Command("put the retained variables on the disk now", takes_effect=False),
}


class CommandError(PlcemuError):
    """A request that cannot be done."""


class Commands:
    """Does requests on a daemon's system."""

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self._access: TagAccess | None = None
        self._special: dict[str, Callable[[], Awaitable[Answer]]] = {
            "reload": self._reload, "commit": self._commit}

    async def handle(self, request: dict[str, Any]) -> Answer:
        """Do a request and return the answer's keys.

        Raises:
            PlcemuError: there is no such command, or it cannot be done.
        """
        name = str(request.get("command", ""))
        command = COMMANDS.get(name)
        if command is None:
            raise CommandError(f"there is no command {name!r}{did_you_mean(name, COMMANDS)}; "
                               f"there is {', '.join(COMMANDS)}")
        values = _values(name, command, request)
        if name in self._special:
            return await self._special[name]()
        work = getattr(self, f"_{name}")
        return await self._daemon.between_scans(lambda: work(**values), command.takes_effect)

    # ------------------------------------------------------------ tags

    def _tags(self) -> TagAccess:
        """Return the access to the tags of the program that runs now."""
        system = self._daemon.system
        if self._access is None or not self._access.is_of(system.resource.memory):
            self._access = TagAccess(system.resource.memory, system.exchange, "control")
        return self._access

    def _get(self, name: str) -> Answer:
        cycle = self._daemon.system.cycle
        value: Value | None
        try:
            value, of = self._tags().read(name), self._tags().type_of(name)
        except UnknownNameError:
            if name not in cycle.tags:
                raise
            index = cycle.tags.find(name)
            value, of = cycle.values()[index], cycle.tags[index].type
        return {"name": name, "type": of, "value": value}

    def _set(self, name: str, value: Any) -> Answer:
        self._tags().write(name, read_value(self._tags().type_of(name), value))
        return {}

    def _force(self, name: str, value: Any) -> Answer:
        self._tags().force(name, read_value(self._tags().type_of(name), value))
        self._daemon.system.resource.inputs_changed()
        return {}

    def _unforce(self, name: str) -> Answer:
        self._tags().unforce(name)
        self._daemon.system.resource.inputs_changed()
        return {}

    # ------------------------------------------------------------ state

    def _stop(self) -> Answer:
        self._daemon.system.cycle.stop()
        return {}

    def _start(self) -> Answer:
        if self._daemon.system.resource.state is not State.RUN:
            self._daemon.system.cycle.resume()
        return {}

    def _restart(self, mode: str) -> Answer:
        self._daemon.system.cycle.restart(cold=mode == "cold")
        return {}

    def _status(self) -> Answer:
        system = self._daemon.system
        report = system.report()
        forced = system.exchange.forces
        memory = system.resource.memory
        places = {memory.place(n)[0]: tag.name for n, tag in enumerate(memory.tags)}
        answer: Answer = {key: report[key] for key in (
            "name", "state", "t_s", "scans", "executed", "overruns", "missed", "fault", "plant",
            "retain") if key in report}
        verdicts = [p["verdict"] for p in report["properties"]]
        answer["properties"] = {verdict: verdicts.count(verdict) for verdict in sorted(
            set(verdicts))}
        answer |= {"forces": sorted(places.get(offset, f"byte {offset}") for offset in forced),
                   "changes": self._daemon.changes, "pid": os.getpid(), "version": __version__,
                   "config": str(system.config.file_path)}
        server = self._daemon.server
        if server is not None:
            answer["modbus"] = {"host": server.host, "port": server.port, **server.counters}
        return answer

    def _alarms(self) -> Answer:
        alarms = self._daemon.system.reactions.alarms
        return {"alarms": [alarm.as_json() for alarm in alarms
                           if alarm.state is not AlarmState.NORMAL]}

    def _ack(self, name: str) -> Answer:
        self._daemon.system.reactions.acknowledge(name)
        return {}

    async def _reload(self) -> Answer:
        report = await self._daemon.reload()
        return report.as_json()

    async def _commit(self) -> Answer:
        return await self._daemon.commit()


def _values(name: str, command: Command, request: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments and options of a request, checked."""
    known = {"command", *command.arguments, *(option for option, _ in command.options)}
    for key in request:
        if key not in known:
            raise CommandError(f"{name} takes no {key!r}{did_you_mean(key, known)}")
    values: dict[str, Any] = {}
    for argument in command.arguments:
        if argument not in request or (argument == "name" and not isinstance(
                request[argument], str)):
            raise CommandError(f"{name} needs a {argument}")
        values[argument] = request[argument]
    for option, choices in command.options:
        values[option] = request.get(option, choices[0])
        if values[option] not in choices:
            raise CommandError(f"{name}: found {option} {values[option]!r}, expected "
                               f"{' or '.join(choices)}")
    return values


_WORDS = {"true": True, "false": False}


def read_value(of: str, value: Any) -> Value:
    """Read a value as a person writes it: `TRUE`, `42`, `16#FF`, `2.5`, `1.5s`, or a text.

    Raises:
        CommandError: it is no value of the type.
    """
    if isinstance(value, bool | int | float):
        return value
    kind = type_of(of)
    text = str(value).strip()
    if isinstance(kind, StringType):
        return str(value)
    try:
        if kind.kind == "float":
            return float(text.replace("_", ""))
        if kind.kind == "bool" and text.lower() in _WORDS:
            return _WORDS[text.lower()]
        base, mark, digits = text.rpartition("#")
        if kind.kind == "time" and not (mark and base.isdigit()):
            return text if not text.lstrip("-").isdigit() else int(text)
        return int(digits.replace("_", ""), int(base)) if mark else int(text.replace("_", ""))
    except ValueError:
        raise CommandError(f"found {value!r}, expected a value of type {of}") from None
