"""Many runs at once: the same functions on many copies of memory.

Who has many runs to make which do not depend on one another, such as a checker, makes them in a
batch. Here they are made one after another, which says what a batch is; `plcemu.engine.wasm_batch`
makes them in one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from plcemu.base.errors import ProgramFault

if TYPE_CHECKING:
    from plcemu.engine.engines import Code
    from plcemu.ir.program import Block


class Shape(NamedTuple):
    """What goes into the runs of a batch, and what is asked of memory after each.

    Attributes:
        inputs: what is written before a run, as slices of the block.
        mask: 0xFF for each byte of the block that matters.
        rest: the block with the values of all other bytes, and zeros for those that matter.
        watched: bytes of the block that are told apart, by offset.
    """

    inputs: Sequence[slice]
    mask: bytes
    rest: bytes
    watched: Sequence[int]


class Ran(NamedTuple):
    """What came of the runs, in their order.

    Attributes:
        memories: the block after each, bytes that do not matter at the values given for them.
        watched: its watched bytes.
        faults: number of the run -> why it was not completed; it has no meaningful memory.
    """

    memories: list[bytes]
    watched: list[bytes]
    faults: dict[int, ProgramFault]


class Batch(Protocol):
    """Makes many runs."""

    def image(self, inputs: Sequence[bytes]) -> bytes:
        """Return inputs, one for each slice, in the form that `run` takes."""

    def run(self, memories: Sequence[bytes], images: Sequence[bytes], elapsed_ns: int) -> Ran:
        """For each copy of the block: write the inputs, let time pass, run the functions."""


class PlainBatch:
    """Makes one run after another.

    Args:
        block: the memory that the functions run on.
        code: the functions.
        shape: what goes in and out.
    """

    def __init__(self, block: Block, code: Code, shape: Shape) -> None:
        self._block, self._code, self._shape = block, code, shape
        self._mask, self._rest = (int.from_bytes(b, "little") for b in (shape.mask, shape.rest))

    def image(self, inputs: Sequence[bytes]) -> bytes:
        """Return inputs, one for each slice, in the form that `run` takes."""
        return b"".join(inputs)

    def run(self, memories: Sequence[bytes], images: Sequence[bytes], elapsed_ns: int) -> Ran:
        """For each copy of the block: write the inputs, let time pass, run the functions."""
        block, shape = self._block, self._shape
        ran = Ran([], [], {})
        for number, (memory, image) in enumerate(zip(memories, images, strict=True)):
            block[:] = memory
            at = 0
            for place in shape.inputs:
                end = at + place.stop - place.start
                block[place], at = image[at:end], end
            try:
                self._code.repeat(1, elapsed_ns)
            except ProgramFault as fault:
                ran.faults[number] = fault
            after = int.from_bytes(block, "little") & self._mask | self._rest
            ran.memories.append(after.to_bytes(len(block), "little"))
            ran.watched.append(bytes([block[n] for n in shape.watched]))
        return ran
