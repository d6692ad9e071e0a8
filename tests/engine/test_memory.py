"""The memory block by itself: clock cells."""

from __future__ import annotations

import struct

from plcemu.engine.interpreter import Interpreter
from plcemu.lang.compile import compile_program


def timer_memory(elapsed: int, limit: int) -> tuple[Interpreter, int]:
    """Return the memory of a program with one timer, whose clock cell is set so."""
    program = compile_program("PROGRAM m VAR t : TON; END_VAR t(); END_PROGRAM")
    memory = Interpreter(program, bytearray(program.layout.initial))
    (clock,) = program.layout.clocks
    struct.pack_into("<qq", memory.block, clock.offset, elapsed, limit)
    return memory, clock.offset


def test_a_running_clock_stops_at_its_limit_so_that_states_recur() -> None:
    memory, offset = timer_memory(20, 25)
    memory.advance_clocks(40)
    assert struct.unpack_from("<qq", memory.block, offset) == (25, 25)


def test_a_clock_beyond_its_limit_stands_still() -> None:
    memory, offset = timer_memory(30, 25)
    memory.advance_clocks(40)
    assert struct.unpack_from("<qq", memory.block, offset) == (30, 25)
