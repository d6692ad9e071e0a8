"""The plant of which nothing is known, `verify.abstraction: free_inputs`: any input, at any time.

With a plant its wired sensors are the inputs; those of the program that are not wired are free as
well, since an operator or another machine may sit behind them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from plant_sim.contract import PortValue
from plant_sim.free_inputs import FreeInputs
from plcemu.base.areas import parse_address
from plcemu.base.errors import did_you_mean
from plcemu.base.tags import Tag
from plcemu.base.types import ELEMENTARY
from plcemu.io.mapping import Point
from plcemu.ir.program import Program
from plcemu.runtime.config import Config
from plcemu.verify.machine import place_of

FREE_INPUTS = "free_inputs"
"""The name of this abstraction."""


def all_inputs(config: Config, wired: Sequence[Point], program: Program) -> tuple[Point, ...]:
    """Return the wired inputs, and all others that a program has, by their variables' names.

    Raises:
        ConfigError: one holds a real number, of which no list of values is all.
    """
    taken = {str(point.address) for point in wired}
    tags: dict[str, Tag] = {}
    for slot in program.layout.slots:
        if slot.tag.address.startswith("%I") and slot.tag.address not in taken:
            tags.setdefault(slot.tag.address, slot.tag)
    names = _short_names([p.name for p in wired], tags.values())
    return (*wired, *(_point(config, name, tag)
                      for name, tag in zip(names, tags.values(), strict=True)))


def _short_names(taken: Iterable[str], tags: Iterable[Tag]) -> list[str]:
    """Return the last part of each tag's name where it is unique, else the whole name."""
    names = [tag.name for tag in tags]
    short = [name.rpartition(".")[2].casefold() for name in names]
    others = [name.casefold() for name in taken]
    return [name.rpartition(".")[2] if (short + others).count(each) == 1 else name
            for name, each in zip(names, short, strict=True)]


def _point(config: Config, name: str, tag: Tag) -> Point:
    kind = ELEMENTARY.get(tag.type)
    if kind is None or kind.kind == "float":
        raise config.mistake(("verify", "abstraction"), f"free inputs: {tag.name} ({tag.address}) "
                             f"is of type {tag.type}; only bits and whole numbers can be free")
    return Point(name, parse_address(tag.address), signed=kind.low < 0)


def is_used(program: Program, point: Point) -> bool:
    """Whether a program has a variable, declared or not, at a point's address."""
    place = place_of(program, point)
    return any(slot.offset == place for slot in program.layout.slots)


def free_inputs(config: Config, inputs: Sequence[Point], program: Program,
                told: Sequence[Point]) -> FreeInputs:
    """Return the plant that may give the inputs any value.

    Inputs of one bit take both values, or those that `verify.parameters` names for them; others
    must have some named, unless the program does not read them. Those stay at FALSE or 0.

    Args:
        config: the configuration.
        inputs: all that are free.
        program: which reads them, or does not.
        told: those whose readings are facts; the others have variables of the same name.

    Raises:
        ConfigError: values of an input are missing or do not fit.
    """
    given = config.verify.parameters
    names = [p.name for p in inputs]
    for name in set(given) - set(names):
        raise config.mistake(("verify", "parameters", name), "is no input"
                             f"{did_you_mean(name, names)}; there are {', '.join(names) or 'none'}")
    values = {point.name: _values(config, point, given.get(point.name), is_used(program, point))
              for point in inputs}
    try:
        return FreeInputs(values, [p.name for p in told])
    except ValueError as problem:
        raise config.mistake(("verify", "parameters"), problem) from None


def _values(config: Config, point: Point, named: object, is_read: bool) -> Sequence[PortValue]:
    where = ("verify", "parameters", point.name)
    if named is None:
        if point.is_bit or not is_read:
            return [False, True] if is_read else [point.to_value(0)]
        raise config.mistake(where, f"is missing: which values may {point.name} ({point.address}) "
                             "read? Give a list")
    values: list[PortValue] = named if isinstance(named, list) else [named]  # type: ignore[list-item]
    for value in values:
        if not isinstance(value, bool | int | float):
            raise config.mistake(where, f"found {value!r}, expected a number, or true or false")
        if point.to_value(point.to_raw(value)) != value:
            raise config.mistake(where, f"{point.name} ({point.address}) cannot read {value}")
    return values
