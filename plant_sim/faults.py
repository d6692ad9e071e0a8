"""Faults by name: what may go wrong with a sensor or actuator, or with the plant itself.

A fault has a target. On a port it is one of the table below. Any other is a disturbance of the
plant: `leak` on `B3` is the port `B3.leak`.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from plant_sim.contract import Port, PortValue


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A row of the table.

    Attributes:
        on_sensor: what it does to a sensor; empty if it cannot have it.
        on_actuator: what it does to an actuator; empty if it cannot have it.
        value: what its value is; empty if it takes none.
        optional: whether the value may be left out.
        bools: whether a Boolean port can have it.
    """

    on_sensor: str
    on_actuator: str
    value: str = ""
    optional: bool = False
    bools: bool = True


FAULTS: dict[str, FaultKind] = {
    "stuck": FaultKind("keeps its reading, or the value", "stays where it is, or at the value",
                       "in the port's unit", optional=True),
    "open": FaultKind("open circuit: reads its low end", "is on, or fully open"),
    "closed": FaultKind("", "is off, or fully closed"),
    "lost": FaultKind("no signal: reads its low end", ""),
    "offset": FaultKind("reads so much too much", "", "in the port's unit", bools=False),
    "drift": FaultKind("reads ever more too much", "", "in the port's unit per s", bools=False),
    "noise": FaultKind("scatters with this standard deviation", "", "in the port's unit",
                       bools=False),
    "slow": FaultKind("reads what was so long ago", "needs so long from end to end", "in s"),
    "wrong_sign": FaultKind("reads mirrored in its range", "does the contrary"),
}
"""Faults of ports."""


class FaultError(ValueError):
    """A fault that there cannot be; the text says what there can."""


class Injection(NamedTuple):
    """A fault that begins at an instant of plant time and lasts, or ends at another."""

    t_ns: int
    target: str
    fault: str
    value: PortValue | None = None
    until_ns: int | None = None


def name_of(fault: str) -> str:
    """A fault's name as in the table: `wrong sign` and `Wrong-Sign` are `wrong_sign`."""
    return "_".join(fault.replace("-", " ").replace("_", " ").split()).casefold()


def check(injection: Injection, ports: Mapping[str, Port]) -> Injection:
    """The injection with the names as the plant writes them. Raises FaultError."""
    target, fault = injection.target, name_of(injection.fault)
    by_fold = {name.casefold(): port for name, port in ports.items()}
    disturbed = by_fold.get(f"{target}.{injection.fault}".casefold()) \
        or by_fold.get(f"{target}.{fault}".casefold())
    port = by_fold.get(target.casefold())
    if injection.until_ns is not None and injection.until_ns <= injection.t_ns:
        raise FaultError("ends before it begins")
    if disturbed is not None and disturbed.direction == "disturbance":
        base = disturbed.name[: -len(fault) - 1]
        return injection._replace(target=base, fault=disturbed.name[len(base) + 1:],
                                  value=_disturbing(disturbed, injection.value))
    if port is None or port.direction == "disturbance":
        raise FaultError(_unknown_target(target, fault, ports))
    kind = FAULTS.get(fault)
    if kind is None or not _can_have(port, kind):
        raise FaultError(_unknown_fault(port, fault, ports))
    value = _port_value(port, kind, fault, injection.value)
    return injection._replace(target=port.name, fault=fault, value=value)


def _can_have(port: Port, kind: FaultKind) -> bool:
    text = kind.on_sensor if port.direction == "sensor" else kind.on_actuator
    return bool(text) and (kind.bools or port.kind == "real")


def _port_value(port: Port, kind: FaultKind, fault: str, value: PortValue | None
                ) -> PortValue | None:
    if value is None:
        if kind.value and not kind.optional:
            raise FaultError(f"{fault} needs a value, {_unit(kind, port)}")
        return None
    if not kind.value:
        raise FaultError(f"{fault} takes no value, found {value!r}")
    if fault == "stuck":
        return _within(port, value)
    if isinstance(value, bool) or (fault in ("slow", "noise") and value < 0):
        raise FaultError(f"found {value!r}, expected a number of {_unit(kind, port)}")
    return float(value)


def _unit(kind: FaultKind, port: Port) -> str:
    return kind.value.replace("the port's unit", port.unit or "the port's unit")


def _within(port: Port, value: PortValue) -> PortValue:
    if port.kind == "bool":
        if value not in (0, 1):
            raise FaultError(f"found {value!r}, expected true or false")
        return bool(value)
    if isinstance(value, bool) or not port.low <= value <= port.high:
        raise FaultError(f"found {value!r}, expected {port.low:g} to {port.high:g} {port.unit}")
    return float(value)


def _disturbing(port: Port, value: PortValue | None) -> PortValue:
    if value is None:
        if port.kind == "bool":
            return True
        raise FaultError(f"{port.name} needs a value, {port.low:g} to {port.high:g} {port.unit}")
    return _within(port, value)


def faults_of(target: str, ports: Collection[Port]) -> list[str]:
    """The faults that a target can have."""
    fold = target.casefold()
    own = [name for port in ports if port.name.casefold() == fold
           for name, kind in FAULTS.items()
           if port.direction != "disturbance" and _can_have(port, kind)]
    return own + [port.name[len(target) + 1:] for port in ports if port.direction == "disturbance"
                  and port.name.casefold().startswith(f"{fold}.")]


def _unknown_fault(port: Port, fault: str, ports: Mapping[str, Port]) -> str:
    can = ", ".join(faults_of(port.name, ports.values()))
    return f"{port.name} cannot have the fault {fault!r}; it can have {can}"


def _unknown_target(target: str, fault: str, ports: Mapping[str, Port]) -> str:
    of_plant = faults_of(target, ports.values())
    if of_plant:
        return f"{target} cannot have the fault {fault!r}; it can have {', '.join(of_plant)}"
    names = [port.name.rpartition(".")[0] if port.direction == "disturbance" else port.name
             for port in ports.values()]
    by_fold = {name.casefold(): name for name in names}
    near = difflib.get_close_matches(target.casefold(), by_fold, n=1)
    hint = f"did you mean {by_fold[near[0]]}?" if near else ", ".join(dict.fromkeys(names))
    return f"the plant has no {target!r} to have a fault: {hint}"
