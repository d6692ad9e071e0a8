"""Many runs at once: the same functions on many copies of memory.

Who has many runs to make which do not depend on one another, such as a checker, makes them in a
batch. The copies stay in it from run to run; only what must be known of each comes back. Here the
runs are made one after another, which says what a batch is; `plcemu.engine.wasm_batch` makes them
in one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from plcemu.base.errors import ProgramFault

if TYPE_CHECKING:
    from plcemu.engine.engines import Code
    from plcemu.ir.program import Block

MOST = 4096
"""Copies of memory in a batch at most."""


class Shape(NamedTuple):
    """What goes into the runs of a batch, and what is told of memory after each.

    Attributes:
        inputs: what is written before a run, as slices of the block.
        mask: 0xFF for each byte of the block that matters.
        rest: the block with the values that all other bytes get, and zeros for those that matter.
        told: bytes of the block that are told, by offset.
    """

    inputs: Sequence[slice]
    mask: bytes
    rest: bytes
    told: Sequence[int]


class Ran(NamedTuple):
    """What came of runs, in their order.

    Attributes:
        told: the told bytes of memory after each.
        changed: for each whether its memory has changed in anything that matters.
        faults: number of the run -> why it was not completed. Its copy of memory is as it was
            before, and nothing else that is told of it means anything.
    """

    told: list[bytes]
    changed: Sequence[int]
    faults: dict[int, ProgramFault]


class Batch(Protocol):
    """Copies of memory, and what runs on them. At most `capacity` copies find room."""

    capacity: int

    def image(self, inputs: Sequence[bytes]) -> bytes:
        """Return inputs, one for each slice, in the form that `run` takes."""

    def load(self, memories: Sequence[bytes]) -> None:
        """Take copies of the block, in which what does not matter has its initial value."""

    def run(self, places: Sequence[int], images: Sequence[bytes], elapsed_ns: int) -> Ran:
        """For each copy, given by its number: write the inputs, let time pass, run the functions.

        A copy may be given once.
        """

    def memories(self) -> list[bytes]:
        """Return the copies as they are now."""


class PlainBatch:
    """Makes one run after another.

    Args:
        block: the memory that the functions run on.
        code: the functions.
        shape: what goes in and out.
    """

    capacity = MOST

    def __init__(self, block: Block, code: Code, shape: Shape) -> None:
        self._block, self._code, self._shape = block, code, shape
        self._mask, self._rest = (int.from_bytes(b, "little") for b in (shape.mask, shape.rest))
        self._memories: list[bytes] = []

    def image(self, inputs: Sequence[bytes]) -> bytes:
        """Return inputs, one for each slice, in the form that `run` takes."""
        return b"".join(inputs)

    def load(self, memories: Sequence[bytes]) -> None:
        """Take copies of the block."""
        self._memories = list(memories)

    def run(self, places: Sequence[int], images: Sequence[bytes], elapsed_ns: int) -> Ran:
        """For each copy: write the inputs, let time pass, run the functions."""
        told, changed, faults = [], [], {}
        for number, (place, image) in enumerate(zip(places, images, strict=True)):
            before = after = self._memories[place]
            try:
                after = self._memories[place] = self._run(before, image, elapsed_ns)
            except ProgramFault as fault:
                faults[number] = fault
            told.append(bytes([after[n] for n in self._shape.told]))
            changed.append(after != before)
        return Ran(told, changed, faults)

    def _run(self, memory: bytes, image: bytes, elapsed_ns: int) -> bytes:
        block, at = self._block, 0
        block[:] = memory
        for place in self._shape.inputs:
            end = at + place.stop - place.start
            block[place], at = image[at:end], end
        self._code.repeat(1, elapsed_ns)
        after = int.from_bytes(block, "little") & self._mask | self._rest
        return after.to_bytes(len(block), "little")

    def memories(self) -> list[bytes]:
        """Return the copies as they are now."""
        return list(self._memories)
