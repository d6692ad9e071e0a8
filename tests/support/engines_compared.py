"""Two engines on the same program: what one does, the other must do byte for byte."""

from __future__ import annotations

import random
from collections.abc import Sequence

from plcemu.base.errors import ProgramFault
from plcemu.base.spans import Source, Span
from plcemu.base.types import type_of
from plcemu.engine.engines import Engine, make_engine
from plcemu.ir.check import check_function
from plcemu.ir.program import ClockCell, Function, Instance, Instr, Layout, Program

LINES = Source("<ir>", "\n" * 100_000)


def numbered(code: Sequence[Instr], first: int = 0) -> tuple[Instr, ...]:
    """Give each instruction a line of its own, so that a fault's place tells which it was."""
    return tuple(Instr(i.op, i.arg, Span(LINES, first + n, first + n + 1))
                 for n, i in enumerate(code))


def program_of(functions: Sequence[Function], image: bytes, clocks: Sequence[ClockCell] = (),
               bases: Sequence[int] = (0, 16)) -> Program:
    """Return a checked program of such functions, whose memory begins as an image.

    Each function may run on instances at several addresses.
    """
    named = {f.name: f for f in functions}
    for function in functions:
        check_function(function, named)
    layout = Layout(image, (), (), tuple(clocks))
    instances = tuple(Instance(f"{f.name}.{base}", f.name, base)
                      for f in functions for base in bases)
    return Program(named, layout, instances, ())


def outcome(engine: Engine, function: str, base: int = 0) -> tuple[str, ...]:
    """Run a function; return its fault's reason, POU and place, or nothing."""
    try:
        engine.run(function, base)
    except ProgramFault as fault:
        return fault.reason, fault.pou, fault.place
    return ()


class Pair:
    """The interpreter and the WebAssembly engine on one program."""

    def __init__(self, program: Program, budget: int = 1_000_000) -> None:
        self.program = program
        self.oracle = make_engine("interpreter", program, budget)
        self.fast = make_engine("wasm", program, budget)

    def write(self, offset: int, data: bytes) -> None:
        """Put bytes into both memories."""
        for engine in (self.oracle, self.fast):
            engine.block[offset:offset + len(data)] = data

    def run(self, function: str, base: int = 0) -> tuple[str, ...]:
        """Run a function on both; return the outcome, which must be the same as the memories."""
        expected = outcome(self.oracle, function, base)
        assert outcome(self.fast, function, base) == expected
        self.same()
        return expected

    def advance(self, elapsed_ns: int) -> None:
        """Let time pass in both."""
        for engine in (self.oracle, self.fast):
            engine.advance_clocks(elapsed_ns)
        assert self.fast.clocks_run() == self.oracle.clocks_run()

    def same(self) -> None:
        """The memories hold the same bytes."""
        assert bytes(self.fast.block) == bytes(self.oracle.block)

    def scan_with_random_inputs(self, seed: int, scans: int, names: Sequence[str] = ()) -> int:
        """Scan all instances with random values in some tags; return how often they faulted.

        Without names, all tags get random values now and then, so also those that the program
        itself writes.
        """
        chance, faults = random.Random(seed), 0
        slots = [s for s in self.program.layout.slots if not names or s.tag.name in names]
        for _ in range(scans):
            self.advance(chance.choice((0, 1_000_000, 10_000_000, 3_000_000_000)))
            for slot in chance.sample(slots, min(len(slots), chance.choice((0, 1, 3)))):
                self.write(slot.offset, random_value(slot.tag.type, chance))
            for instance in self.program.instances:
                faults += self.run(instance.function, instance.base) != ()
        return faults


def random_value(type_name: str, chance: random.Random) -> bytes:
    """Return bytes of a type: often an edge, else anything."""
    row = type_of(type_name)
    size = row.size
    if type_name == "BOOL":
        return bytes([chance.randrange(2)])
    if "STRING" in type_name:
        return row.pack(chance.choice(("", "7", "-12", "abc", "TRUE", "T#5s"))[:size - 2])
    edges = (0, 1, 2, 10, (1 << 8 * size) - 1, 1 << 8 * size - 1, (1 << 8 * size - 1) - 1,
             chance.getrandbits(8 * size), chance.randrange(100))
    return (chance.choice(edges) & (1 << 8 * size) - 1).to_bytes(size, "little")
