"""Finite plants and programs for comparing SPIN with our own checker."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

from verify_toys import NAMES, Steps

from plant_sim.contract import Fact
from plcemu.base.areas import parse_address
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.lang.compile import compile_program
from plcemu.monitor import parse_properties
from plcemu.runtime.second_opinion import Opinion, ask_spin
from plcemu.verify.explore import Limits
from plcemu.verify.promela.plant import RecordedPlant
from plcemu.verify.prove import Prover, Result


class Place(NamedTuple):
    """A state of one of many systems."""

    system: int
    state: int


class Systems:
    """Many transition systems as one finite plant; a run begins in one of them and stays there.

    Sensor `here` reads the state's number.
    """

    facts = (Fact("state", "int", "", "the number of the state"),)

    def __init__(self, systems: Sequence[Steps]) -> None:
        self.systems = systems

    def initial(self) -> Iterator[Place]:
        return (Place(n, 0) for n in range(len(self.systems)))

    def name_of(self, state: Any) -> str:
        return f"system {state.system}"

    def sense(self, state: Any) -> dict[str, Any]:
        return {"here": state.state}

    def actuate(self, state: Any, values: Mapping[str, Any]) -> Any:
        return state

    def actions(self, state: Any) -> list[str]:
        return self.systems[state.system].actions(state.state)

    def after(self, state: Any, action: str) -> Place:
        return Place(state.system, self.systems[state.system].next(state.state, action))

    def observe(self, state: Any) -> dict[str, Any]:
        return {"state": state.state}

    def pending(self, state: Any) -> Collection[str]:
        return self.systems[state.system].pending(state.state)

    def done(self, action: str) -> Collection[str]:
        return (action,)


def random_steps(seed: int) -> Steps:
    """A random system of up to seven states with three actions; what can be done may be pending."""
    chance = random.Random(seed)
    size = chance.randrange(2, 8)
    table = {n: {name: chance.randrange(size) for name in NAMES if chance.random() < 0.5}
             for n in range(size)}
    waiting = {n: frozenset(name for name in row if chance.random() < 0.6)
               for n, row in table.items()}
    return Steps(table, waiting)


def point(name: str, address: str) -> Point:
    """An input or output by its name."""
    return Point(name, parse_address(address), Fraction(1))


def both(program: str, plant: Any, inputs: Sequence[Point], outputs: Sequence[Point],
         demands: str, **options: Any) -> tuple[Result, Opinion]:
    """Our verdicts and SPIN's on a program with a finite plant."""
    prover = Prover(Resource(compile_program(program), 10_000_000), RecordedPlant(plant), inputs,
                    outputs, 10_000_000, parse_properties(demands), **options)
    result = prover.prove(Limits(seconds=60))
    return result, ask_spin(prover, result, "a test", Limits(seconds=60))


def mutated(folder: Path, source: Path, before: str, after: str) -> Path:
    """Write a program with one change; return its path."""
    text = source.read_text(encoding="utf-8")
    assert before in text
    path = folder / source.name
    path.write_text(text.replace(before, after), encoding="utf-8")
    return path
