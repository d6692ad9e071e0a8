"""Clock cells: how time passes in a memory that holds no absolute time."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from plcemu.ir.program import Block, ClockCell

_CLOCK = struct.Struct("<qq")


def advance_clocks(block: Block, clocks: Iterable[ClockCell],
                   elapsed_ns: int) -> None:
    """Add time to every running clock cell, up to the cell's limit."""
    for clock in clocks:
        elapsed, limit = _CLOCK.unpack_from(block, clock.offset)
        if elapsed < limit:
            _CLOCK.pack_into(block, clock.offset, min(elapsed + elapsed_ns, limit), limit)


def clocks_run(block: Block, clocks: Iterable[ClockCell]) -> bool:
    """Whether a clock cell runs that the program reads."""
    for clock in clocks:
        if clock.observed:
            elapsed, limit = _CLOCK.unpack_from(block, clock.offset)
            if elapsed < limit:
                return True
    return False
