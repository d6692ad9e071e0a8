"""Many runs in one call of WebAssembly.

A call costs some 0.5 us and what Python does around it more, where the run itself takes a few
tenths of a microsecond.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import NoReturn

from plcemu.base.errors import ProgramFault
from plcemu.engine import native
from plcemu.engine.batch import MOST, Ran, Shape
from plcemu.engine.wat_batch import COMPLETED, JOB, whole_words

_COUNT = struct.Struct("<Q")
_ADDRESS = struct.Struct("<I")


class WasmBatch:
    """Makes all runs in one call.

    Args:
        machine: the instance.
        head: its memory before the block, which begins where this ends.
        room: address from which on `head` is free.
        runs: where the list of functions to run begins and ends.
        budget: instructions that jumps backwards may cost in one run.
        shape: what goes in and out.
        stop: turns what stopped the code into a fault.

    Raises:
        MemoryError: there is no room for a single copy.
    """

    def __init__(self, machine: native.Machine, head: memoryview, room: int,
                 runs: tuple[int, int], budget: int, shape: Shape,
                 stop: Callable[[native.Stopped], NoReturn]) -> None:
        self._head, self._stop = head, stop
        origin, size = len(head), len(shape.mask)
        self._size, self._slot = size, whole_words(size)
        lengths = [place.stop - place.start for place in shape.inputs]
        self._order = whole_words(_ADDRESS.size + sum(lengths))
        self._tail = bytes(self._order - _ADDRESS.size - sum(lengths))
        self._tell = 1 + len(shape.told)
        mask = room + whole_words(JOB.size)
        rest, scratch, inputs = (mask + n * self._slot for n in (1, 2, 3))
        told = inputs + 8 * len(lengths)
        end = told + _ADDRESS.size * len(shape.told)
        self._first = whole_words(end)
        free = origin - self._first
        self.capacity = min(MOST, free // (self._slot + self._order + self._tell))
        if self.capacity < 1:
            raise MemoryError
        self._orders = self._first + self.capacity * self._slot
        self._told = self._orders + self.capacity * self._order
        self._addresses = [_ADDRESS.pack(self._first + n * self._slot)
                           for n in range(self.capacity)]
        pad = bytes(self._slot - size)
        self._room = room
        self._job = b"".join((
            JOB.pack(self._order, self._tell, mask, rest, scratch, inputs, told, end),
            shape.mask, pad, shape.rest, pad, bytes(self._slot),
            *(struct.pack("<II", origin + place.start, length)
              for place, length in zip(shape.inputs, lengths, strict=True)),
            *(_ADDRESS.pack(offset) for offset in shape.told)))
        self._entry = machine.entry("each", [*runs, 0, 0, budget, room, self._orders, self._told])
        self._loaded = 0

    def image(self, inputs: Sequence[bytes]) -> bytes:
        """Return inputs, one for each slice, in the form that `run` takes."""
        return b"".join((*inputs, self._tail))

    def load(self, memories: Sequence[bytes]) -> None:
        """Take copies of the block."""
        self._loaded = len(memories)
        # All batches of an instance share its room.
        self._head[self._room:self._room + len(self._job)] = self._job
        if self._slot == self._size:
            data = b"".join(memories)
        else:
            data = b"".join([memory.ljust(self._slot, b"\0") for memory in memories])
        self._head[self._first:self._first + len(data)] = data

    def run(self, places: Sequence[int], images: Sequence[bytes], elapsed_ns: int) -> Ran:
        """For each copy: write the inputs, let time pass, run the functions."""
        addresses, count = self._addresses, len(places)
        parts = [addresses[n] for n in places] * 2
        parts[::2], parts[1::2] = parts[:count], images
        self._head[self._orders:self._orders + count * self._order] = b"".join(parts)
        faults = self._call(count, elapsed_ns)
        tell = self._tell
        data = bytes(self._head[self._told:self._told + count * tell])
        return Ran([data[at + 1:at + tell] for at in range(0, len(data), tell)], data[::tell],
                   faults)

    def _call(self, count: int, elapsed_ns: int) -> dict[int, ProgramFault]:
        """Carry out so many orders; return which fault."""
        faults: dict[int, ProgramFault] = {}
        entry, done = self._entry, 0
        entry.set(3, elapsed_ns)
        while done < count:
            entry.set(2, count - done)
            entry.set(6, self._orders + done * self._order)
            entry.set(7, self._told + done * self._tell)
            try:
                entry.call()
                break
            except native.Stopped as stopped:
                done += _COUNT.unpack_from(self._head, COMPLETED)[0]
                try:
                    self._stop(stopped)
                except ProgramFault as fault:
                    faults[done] = fault
                done += 1
        return faults

    def memories(self) -> list[bytes]:
        """Return the copies as they are now."""
        data = bytes(self._head[self._first:self._first + self._loaded * self._slot])
        return [data[at:at + self._size] for at in range(0, len(data), self._slot)]
