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
from plcemu.engine.batch import Ran, Shape
from plcemu.engine.wat_batch import COMPLETED, JOB, whole_words

_COUNT = struct.Struct("<Q")


class WasmBatch:
    """Makes as many runs in each call as find room.

    Args:
        machine: the instance.
        head: its memory before the block, which begins where this ends.
        room: address from which on `head` is free.
        runs: where the list of functions to run begins and ends.
        budget: instructions that jumps backwards may cost in one run.
        shape: what goes in and out.
        stop: turns what stopped the code into a fault.

    Raises:
        MemoryError: there is no room for a single record.
    """

    def __init__(self, machine: native.Machine, head: memoryview, room: int,
                 runs: tuple[int, int], budget: int, shape: Shape,
                 stop: Callable[[native.Stopped], NoReturn]) -> None:
        origin, self._size = len(head), len(shape.mask)
        self._head, self._stop = head, stop
        whole = whole_words(self._size)
        written = sum(place.stop - place.start for place in shape.inputs)
        self._watched_at, self._watched = whole + written, len(shape.watched)
        self._stride = whole_words(self._watched_at + self._watched)
        self._pad = bytes(whole - self._size)
        self._tail = bytes(self._stride - whole - written)
        mask_at = room + whole_words(JOB.size)
        rest_at = mask_at + whole
        inputs_at = rest_at + whole
        watched_at = inputs_at + 8 * len(shape.inputs)
        end = watched_at + 4 * len(shape.watched)
        self._first = whole_words(end)
        self._capacity = (origin - self._first) // self._stride
        if self._capacity < 1:
            raise MemoryError
        self._job_at = room
        self._job = b"".join((
            JOB.pack(self._stride, self._watched_at, mask_at, rest_at, inputs_at, watched_at, end)
            .ljust(whole_words(JOB.size), b"\0"),
            shape.mask, self._pad, shape.rest, self._pad,
            *(struct.pack("<II", origin + place.start, place.stop - place.start)
              for place in shape.inputs),
            *(struct.pack("<I", origin + offset) for offset in shape.watched)))
        self._entry = machine.entry("each", [*runs, 0, 0, budget, room, self._first])

    def image(self, inputs: Sequence[bytes]) -> bytes:
        """Return inputs, one for each slice, in the form that `run` takes."""
        return b"".join((self._pad, *inputs, self._tail))

    def run(self, memories: Sequence[bytes], images: Sequence[bytes], elapsed_ns: int) -> Ran:
        """For each copy of the block: write the inputs, let time pass, run the functions."""
        head, first, stride, size = self._head, self._first, self._stride, self._size
        head[self._job_at:self._job_at + len(self._job)] = self._job
        self._entry.set(3, elapsed_ns)
        ran = Ran([], [], {})
        for begin in range(0, len(memories), self._capacity):
            parts = list(memories[begin:begin + self._capacity]) * 2
            count = len(parts) // 2
            parts[::2], parts[1::2] = parts[:count], images[begin:begin + count]
            end = first + count * stride
            head[first:end] = b"".join(parts)
            self._call(count, begin, ran.faults)
            data = bytes(head[first:end])
            ran.memories.extend([data[at:at + size] for at in range(0, len(data), stride)])
            at = range(self._watched_at, len(data), stride)
            ran.watched.extend([data[n:n + self._watched] for n in at])
        return ran

    def _call(self, count: int, number: int, faults: dict[int, ProgramFault]) -> None:
        """Run so many records, the first of which has that number among all; note who faults."""
        done = 0
        while done < count:
            self._entry.set(2, count - done)
            self._entry.set(6, self._first + done * self._stride)
            try:
                self._entry.call()
                return
            except native.Stopped as stopped:
                done += _COUNT.unpack_from(self._head, COMPLETED)[0]
                try:
                    self._stop(stopped)
                except ProgramFault as fault:
                    faults[number + done] = fault
                done += 1
