"""The scan as a function: memory in, memory out, by the engine that runs the program.

Everything a checker cuts away from memory is cut here: bytes outside the cone of influence stand at
their initial values in every state, so that states which differ in nothing that matters are equal.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from plcemu.base.errors import PlcemuError
from plcemu.engine.batch import Batch, Shape
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.ir.program import Block, Program

Image = list[tuple[slice, bytes]]
"""What inputs read, as stretches of memory to be written."""


class ScanMachine:
    """Scans of one program on its real memory block.

    Args:
        resource: of the program, at its cold start; all its tasks are released in every scan.
        inputs: where the plant's readings go, in the order of the values given to `image`.
        kept: the bytes of memory that matter, by offset; all if None.

    Raises:
        PlcemuError: tasks have events or different intervals, or an input is not there.
    """

    def __init__(self, resource: Resource, inputs: Sequence[Point] = (),
                 kept: Iterable[int] | None = None) -> None:
        program = resource.program
        kept = None if kept is None else frozenset(kept)
        self.resource = resource
        self._block = resource.engine.block
        self._runs = _simple_runs(program, resource)
        self._code = resource.engine.prepare(self._runs)
        self._places = [_place(program, point) for point in inputs]
        self._stretches = _stretches(zip(self._places, (p.width for p in inputs), strict=True))
        self.order = [n for _, numbers in self._stretches for n in numbers]
        """The numbers of the inputs as they follow one another in memory."""
        self._size = len(program.layout.initial)
        self.initial = bytes(program.layout.initial)
        self.has_clocks = any(c.observed and (kept is None or c.offset in kept)
                              for c in program.layout.clocks)
        self._mask = mask_of(self._size, kept)
        rest = ~self._mask & ((1 << 8 * self._size) - 1)
        self._rest = int.from_bytes(self.initial, "little") & rest
        self.scans = 0
        """Scans executed so far."""

    def reduced(self, memory: Block | bytes) -> bytes:
        """Return memory with everything that does not matter at its initial value."""
        number = int.from_bytes(memory, "little") & self._mask | self._rest
        return number.to_bytes(self._size, "little")

    def image(self, raw: Sequence[bytes]) -> Image:
        """Return the inputs' raw values, little-endian, as stretches of memory to be written."""
        return [(place, b"".join([raw[n] for n in numbers]))
                for place, numbers in self._stretches]

    def scan(self, memory: bytes, image: Sequence[tuple[slice, bytes]],
             elapsed_ns: int = 0) -> bytes:
        """Return memory after one scan: latch the inputs, let time pass, run the tasks.

        Raises:
            ProgramFault: the program faults.
        """
        block = self._block
        block[:] = memory
        for stretch, data in image:
            block[stretch] = data
        self._code.repeat(1, elapsed_ns)
        self.scans += 1
        return bytes(block)

    def batch(self, told: Sequence[int]) -> Batch:
        """Return what makes many scans at once, and tells the bytes at these offsets.

        Its inputs are raw values in `order`. Who uses it counts the scans.
        """
        mask, rest = (number.to_bytes(self._size, "little") for number in (self._mask, self._rest))
        return self.resource.engine.batch(
            self._runs, Shape([place for place, _ in self._stretches], mask, rest, told))


def mask_of(size: int, offsets: Iterable[int] | None) -> int:
    """Return bytes of a block, by offset, as a mask of the block read as one number."""
    mask = bytearray(size if offsets is not None else b"\xff" * size)
    for offset in offsets or ():
        mask[offset] = 0xFF
    return int.from_bytes(mask, "little")


def _stretches(places: Iterable[tuple[int, int]]) -> list[tuple[slice, list[int]]]:
    """Return the fewest slices that cover places given as (offset, width), and nothing else.

    Each comes with the numbers of its places in order.
    """
    merged: list[tuple[slice, list[int]]] = []
    for (start, width), number in sorted((place, n) for n, place in enumerate(places)):
        if merged and merged[-1][0].stop == start:
            before, numbers = merged.pop()
            merged.append((slice(before.start, start + width), [*numbers, number]))
        else:
            merged.append((slice(start, start + width), [number]))
    return merged


def _simple_runs(program: Program, resource: Resource) -> list[tuple[str, int]]:
    """Return the code of all tasks by priority, if one release runs them all."""
    tasks = resource.tasks
    if any(t.event for t in tasks) or len({t.interval_ns for t in tasks}) > 1 \
            or any(t.phase_ns for t in tasks):
        raise PlcemuError("only programs whose tasks have one interval, no phase and no event can "
                          "be verified")
    return [(i.function, i.base) for t in tasks for i in map(program.instance, t.programs)]


def _place(program: Program, point: Point) -> int:
    """Return where a point's raw value stands in memory, whose numbers are little-endian."""
    offset = place_of(program, point)
    if offset is None:
        raise PlcemuError(f"{point.name}: the program has no variable at {point.address}")
    return offset


def place_of(program: Program, point: Point) -> int | None:
    """Return a point's offset in the memory block; None if the program does not use it."""
    area, index = point.address.area, point.address.index
    for extent in program.layout.extents:
        if extent.area == area and extent.first <= index < extent.first + extent.count:
            return extent.offset + (index - extent.first) * point.width
    return None
