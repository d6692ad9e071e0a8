"""A plant of which nothing is known: its sensors may read anything at any time.

What is proved against it holds whatever the plant does, as in the paper on the heating tank, whose
model checker lets every input change freely.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import NamedTuple

from plant_sim.contract import Fact, FactValue, PortValue

MOST_READINGS = 4096
"""Combinations of readings that a state may be followed by; more would be a mistake."""


class Readings(NamedTuple):
    """What all sensors read, in their order."""

    values: tuple[PortValue, ...]


class Reads(NamedTuple):
    """The action by which sensors come to read something else."""

    changes: tuple[tuple[str, PortValue], ...]

    def __str__(self) -> str:
        return ", ".join(f"{name} = {_shown(value)}" for name, value in self.changes)


def _shown(value: PortValue) -> str:
    return str(value).upper() if isinstance(value, bool) else str(value)


class FreeInputs:
    """Every sensor takes any of its values, at any time. At first each reads the first one.

    Args:
        values: for each sensor the values that it may read; at least one.
        told: the sensors whose readings are facts; None for all.

    Raises:
        ValueError: a sensor has no values, or all together have too many.
    """

    def __init__(self, values: Mapping[str, Sequence[PortValue]],
                 told: Collection[str] | None = None) -> None:
        empty = [name for name, each in values.items() if not each]
        if empty:
            raise ValueError(f"{', '.join(empty)}: no value that it may read")
        many = prod(len(each) for each in values.values())
        if many > MOST_READINGS:
            raise ValueError(f"the sensors can read {many:,} combinations of values, and more than "
                             f"{MOST_READINGS:,} are too many; give some of them a single value")
        self._names = tuple(values)
        self._told = set(self._names if told is None else told)
        # The first sensor changes fastest, so that shortest counterexamples have few readings on.
        self._all = [Readings(tuple(reversed(row)))
                     for row in product(*reversed([tuple(v) for v in values.values()]))]

    @property
    def facts(self) -> tuple[Fact, ...]:
        """What the sensors read, also those that the program does not ask."""
        kinds = {bool: "bool", int: "int"}
        return tuple(Fact(name, kinds.get(type(value), "real"), "", f"what {name} reads")  # type: ignore[arg-type]
                     for name, value in zip(self._names, self._all[0].values, strict=True)
                     if name in self._told)

    def initial(self) -> Iterator[Readings]:
        """Every sensor at its first value."""
        yield self._all[0]

    def name_of(self, state: Readings) -> str:
        """What is on, in words."""
        on = [name for name, value in zip(self._names, state.values, strict=True) if value]
        return f"all inputs off but {', '.join(on)}" if on else "all inputs off"

    def sense(self, state: Readings) -> Mapping[str, PortValue]:
        """What the sensors read."""
        return dict(zip(self._names, state.values, strict=True))

    def actuate(self, state: Readings, values: Mapping[str, PortValue]) -> Readings:
        """Nothing: sensors do not depend on actuators."""
        return state

    def actions(self, state: Readings) -> Sequence[Reads]:
        """Every other combination of readings."""
        return [Reads(tuple((n, new) for n, old, new in
                            zip(self._names, state.values, other.values, strict=True)
                            if old != new)) for other in self._all if other != state]

    def after(self, state: Readings, action: Reads) -> Readings:
        """The readings after a change."""
        return Readings(tuple({**self.sense(state), **dict(action.changes)}.values()))

    def observe(self, state: Readings) -> Mapping[str, FactValue]:
        """What the sensors read whose readings are facts."""
        return {name: value for name, value in self.sense(state).items() if name in self._told}

    def pending(self, state: Readings) -> Collection[str]:
        """Nothing: a reading may stay as it is for ever."""
        return ()

    def done(self, action: Reads) -> Collection[str]:
        """Nothing."""
        return ()
