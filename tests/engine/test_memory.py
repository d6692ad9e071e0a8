"""Clock cells: how they count, and when they still matter."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.engine.engines import Engine, make_engine
from plcemu.engine.memory import Memory
from plcemu.lang.compile import compile_program

PROGRAM = compile_program("PROGRAM m VAR t : TON; END_VAR t(); END_PROGRAM")
(CLOCK,) = PROGRAM.layout.clocks


@pytest.fixture(params=["interpreter", "wasm"])
def engine(request: pytest.FixtureRequest) -> Engine:
    return make_engine(request.param, PROGRAM)


def after(engine: Engine, elapsed: int, limit: int, passed: int) -> tuple[int, int]:
    """Set the timer's clock cell, let time pass, and return the cell."""
    struct.pack_into("<qq", engine.block, CLOCK.offset, elapsed, limit)
    engine.advance_clocks(passed)
    return struct.unpack_from("<qq", engine.block, CLOCK.offset)


def test_a_running_clock_stops_at_its_limit_so_that_states_recur(engine: Engine) -> None:
    assert after(engine, 20, 25, 40) == (25, 25)
    assert not engine.clocks_run()


def test_a_running_clock_counts_what_has_passed(engine: Engine) -> None:
    assert after(engine, 20, 25, 4) == (24, 25)
    assert engine.clocks_run()


def test_a_clock_beyond_its_limit_stands_still(engine: Engine) -> None:
    assert after(engine, 30, 25, 40) == (30, 25)


@pytest.mark.parametrize("passed", [1, 2**63 - 1, 2**63, 2**64, 2**70])
def test_no_time_is_too_long_for_a_clock(engine: Engine, passed: int) -> None:
    assert after(engine, -(2**63), 2**63 - 1, passed) == (min(passed - 2**63, 2**63 - 1), 2**63 - 1)
    assert after(engine, 2**63 - 2, 2**63 - 1, passed) == (2**63 - 1, 2**63 - 1)


WIDE = compile_program("PROGRAM m VAR a : ARRAY[0..40] OF INT; b : BOOL; c : STRING[9]; "
                       "d : LREAL; t : TON; END_VAR END_PROGRAM")
pokes = st.lists(st.lists(st.tuples(st.integers(0, WIDE.layout.size - 1), st.integers(0, 1)),
                          max_size=5), max_size=8)


@given(pokes)
def test_changes_are_the_tags_whose_values_differ(rounds: list[list[tuple[int, int]]]) -> None:
    memory = Memory(WIDE.layout, bytearray(WIDE.layout.initial))
    memory.values()
    for places in rounds:
        for at, bit in places:
            memory.block[at] ^= 1 << bit
        differing = [i for i in range(len(memory.tags)) if i not in memory.idle_tags
                     and slot_bytes(memory, i) != slot_bytes(memory, i, memory.shown)]
        assert memory.changes() == tuple((i, memory.read(i)) for i in differing)
        assert memory.changes() == ()


def slot_bytes(memory: Memory, index: int, block: bytes | None = None) -> bytes:
    offset, row = memory.place(index)
    return bytes((memory.block if block is None else block)[offset:offset + row.size])
