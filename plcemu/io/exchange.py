"""The exchange: the only door between the world and the process image.

Outside, every client has a `Port`: it reads the last published image together with its own writes
that are still waiting, and its writes queue in order. Inside, the scan latches all waiting writes
together (`update_inputs`) and publishes the image again (`update_outputs`).

The image of an area is kept as bytes in wire order: bits packed from the lowest upwards, larger
elements big-endian. The engine's memory holds a BOOL in a byte and numbers little-endian; the
conversion happens here, once a scan, and only where something changed.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from plcemu.base.areas import AREAS, SIZES
from plcemu.base.errors import LimitError

MEMORY = "MEMORY"
"""Pseudo-area for variables without an address: offsets and bytes are those of the memory block."""

PENDING_LIMIT = 65_536
"""The largest number of writes that may wait for one scan; one more is refused."""

TARGETS_LIMIT = 4096
"""Stretches of the image whose places in memory are remembered; then they are found anew."""


@dataclass(frozen=True, slots=True)
class Extent:
    """A stretch of an area that the program uses, and where it stands in the memory block.

    Attributes:
        area: two letters, such as `QX`.
        first: its first element (for an area X the first bit, a multiple of 8).
        count: its elements (for an area X bits, a multiple of 8).
        offset: of its first element in the memory block, in bytes.
    """

    area: str
    first: int
    count: int
    offset: int

    @property
    def is_bits(self) -> bool:
        """Whether each element is one bit of the image and one byte of memory."""
        return self.area[1] == "X"

    @property
    def width(self) -> int:
        """Bytes of one element in memory."""
        return SIZES[self.area[1]]

    @property
    def image_slice(self) -> slice:
        """Where it stands in the area's image, in bytes."""
        if self.is_bits:
            return slice(self.first // 8, (self.first + self.count) // 8)
        return slice(self.first * self.width, (self.first + self.count) * self.width)

    @property
    def memory_slice(self) -> slice:
        """Where it stands in the memory block, in bytes."""
        return slice(self.offset, self.offset + self.count * self.width)

    def part(self, begin: int, end: int) -> Extent | None:
        """Return the elements that bytes [begin, end) of the area's image touch, or None."""
        first, last = (begin * 8, end * 8) if self.is_bits else \
            (begin // self.width, -(-end // self.width))
        first, last = max(self.first, first), min(self.first + self.count, last)
        if first >= last:
            return None
        offset = self.offset + (first - self.first) * self.width
        return replace(self, first=first, count=last - first, offset=offset)

    def to_image(self, raw: bytes) -> bytes:
        """Convert memory bytes to image bytes."""
        if not self.is_bits:
            return _swapped(raw, self.width)
        return int(raw[::-1].translate(_DIGITS), 2).to_bytes(self.count // 8, "little")

    def to_memory(self, image: bytes) -> bytes:
        """Convert image bytes to memory bytes."""
        if not self.is_bits:
            return _swapped(image, self.width)
        digits = format(int.from_bytes(image, "little"), f"0{self.count}b").encode()
        return digits.translate(_VALUES)[::-1]


_DIGITS = bytes(48 + (i != 0) for i in range(256))
_VALUES = bytes(1 if i == 49 else 0 for i in range(256))


def _swapped(data: bytes, width: int) -> bytes:
    """Reverse the bytes of every element of `width` bytes."""
    if width == 1:
        return bytes(data)
    elements = array(_CODES[width], data)
    elements.byteswap()
    return elements.tobytes()


_CODES = {array(code).itemsize: code for code in "HIQ"}
"""Type codes of arrays by the bytes of an element."""


class Waiting(NamedTuple):
    """A write that waits: the name of the client's port, then the arguments of `Port.write`."""

    port: str
    area: str
    offset: int
    data: bytes
    mask: bytes | None


class _Part(NamedTuple):
    """A part of an extent: where it stands in memory and in the image, what converts its bytes."""

    in_memory: slice
    in_image: slice
    to_image: Callable[[bytes], bytes]
    to_memory: Callable[[bytes], bytes]


def _part(extent: Extent) -> _Part:
    places = extent.memory_slice, extent.image_slice
    if extent.count == 1 and not extent.is_bits:
        return _Part(*places, _reversed, _reversed)
    return _Part(*places, extent.to_image, extent.to_memory)


def _reversed(element: bytes) -> bytes:
    return element[::-1]


class _Target(NamedTuple):
    """What a write to a stretch of an area's image touches in memory.

    Attributes:
        parts: of the extents, that the write touches.
        whole: whether it replaces all of them, if it has no mask.
    """

    parts: tuple[_Part, ...]
    whole: bool


class Checkpoint(NamedTuple):
    """The image of every area, one after another, and the forces by memory offset."""

    image: bytes
    forces: dict[int, bytes]


class _Write(NamedTuple):
    port: Port
    area: str
    offset: int
    data: bytes
    mask: bytes | None


def _merge(target: bytearray | memoryview, offset: int, data: bytes, mask: bytes | None) -> None:
    if mask is None:
        target[offset:offset + len(data)] = data
        return
    for i, (value, bits) in enumerate(zip(data, mask, strict=True), offset):
        target[i] = (target[i] & ~bits & 0xFF) | (value & bits)


class Port:
    """One client's view of the exchange.

    Attributes:
        name: who it is, for logs and for the choice of who drives the inputs.
    """

    def __init__(self, exchange: Exchange, name: str) -> None:
        self.name = name
        self._exchange = exchange
        self._pending: list[_Write] = []

    def read(self, area: str, offset: int, n: int) -> bytes:
        """Return `n` bytes of an area from a byte offset: as published, own writes over it.

        Raises:
            KeyError: there is no such area.
            IndexError: the stretch leaves the area.
        """
        data = bytearray(self._exchange.published(area, offset, n))
        for write in self._pending:
            if write.area == area and write.offset < offset + n \
                    and offset < write.offset + len(write.data):
                low = max(write.offset, offset)
                high = min(write.offset + len(write.data), offset + n)
                part = slice(low - write.offset, high - write.offset)
                mask = write.mask[part] if write.mask is not None else None
                _merge(data, low - offset, write.data[part], mask)
        return bytes(data)

    def write(self, area: str, offset: int, data: bytes, mask: bytes | None = None) -> None:
        """Queue bytes for an area's image; with a mask only the bits that are 1 in it.

        Raises:
            KeyError: there is no such area.
            IndexError: the stretch leaves the area.
            ValueError: the mask is not as long as the data.
            LimitError: `PENDING_LIMIT` writes wait for the next scan already.
        """
        exchange = self._exchange
        exchange.check_place(area, offset, len(data))
        if mask is not None and len(mask) != len(data):
            raise ValueError(f"a mask of {len(mask)} bytes for {len(data)} bytes of data")
        write = _Write(self, area, offset, bytes(data), mask)
        exchange.queue(write)
        self._pending.append(write)

    @property
    def pending(self) -> tuple[tuple[str, int, bytes, bytes | None], ...]:
        """The writes that wait for the next scan, as the arguments of `write`."""
        return tuple((w.area, w.offset, w.data, w.mask) for w in self._pending)

    def latched(self) -> None:
        """Forget the writes that have gone into the image (called by the exchange)."""
        self._pending.clear()


def _grouped(extents: Sequence[Extent]) -> dict[str, list[int]]:
    """Return the numbers of each area's extents."""
    by_area: dict[str, list[int]] = {}
    for n, extent in enumerate(extents):
        by_area.setdefault(extent.area, []).append(n)
    return by_area


def _same_element(offset: int, old: Sequence[Extent], new: Sequence[Extent]) -> int | None:
    """Return where the element of an area that stands at an offset stands in other extents."""
    for extent in old:
        if extent.memory_slice.start <= offset < extent.memory_slice.stop:
            element = extent.first + (offset - extent.offset) // extent.width
            for other in new:
                if other.area == extent.area and 0 <= element - other.first < other.count:
                    return other.offset + (element - other.first) * other.width
    return None


class Exchange:
    """The process image as the world sees it, over one memory block.

    Args:
        memory: the engine's memory block.
        extents: the stretches of the areas that stand in it.
    """

    def __init__(self, memory: bytearray | memoryview, extents: Sequence[Extent] = ()) -> None:
        self._image = {area: bytearray(size) for area, size in AREAS.items()}
        self._queue: list[_Write] = []
        self._forces: dict[int, bytes] = {}
        self._stand_over(memory, extents)
        self.version = 0
        """Another number whenever something but inputs may have changed in the image."""
        self.writers: set[str] = set()
        """The names of the ports whose writes went into input areas at the last latch."""
        self.update_outputs()

    def _stand_over(self, memory: bytearray | memoryview, extents: Sequence[Extent]) -> None:
        """Take a memory block, and note where its stretches stand in the image."""
        self._memory = memory
        self._extents = tuple(extents)
        self._by_area = _grouped(self._extents)
        self._targets: dict[tuple[str, int, int], _Target] = {}
        self._parts = [(e.area, _part(e)) for e in self._extents]
        # What the image shows of memory up to its last extent; empty if that is not known.
        self._end = max((e.memory_slice.stop for e in self._extents), default=0)
        self._shown = bytearray()

    def port(self, name: str) -> Port:
        """Return a new client's view."""
        return Port(self, name)

    @property
    def waiting(self) -> int:
        """The number of writes that wait for the next scan."""
        return len(self._queue)

    def published(self, area: str, offset: int, n: int) -> bytes:
        """Return bytes of an area's published image (of memory, for the pseudo-area MEMORY)."""
        return bytes(self.check_place(area, offset, n)[offset:offset + n])

    def check_place(self, area: str, offset: int, n: int) -> bytearray | memoryview:
        """Return an area's image (memory, for MEMORY) if it has these bytes.

        Raises:
            KeyError: there is no such area.
            IndexError: the stretch leaves the area.
        """
        image = self._memory if area == MEMORY else self._image[area]
        if offset < 0 or n < 0 or offset + n > len(image):
            raise IndexError(f"bytes {offset} to {offset + n} of {area} ({len(image)} bytes)")
        return image

    def queue(self, write: _Write) -> None:
        """Let a write wait for the next scan."""
        if len(self._queue) >= PENDING_LIMIT:
            raise LimitError(f"{PENDING_LIMIT} writes wait for the next scan; no more are taken")
        self._queue.append(write)

    def force(self, offset: int, data: bytes) -> None:
        """Hold bytes of memory at a value from the next scan on, whoever writes them.

        Raises:
            IndexError: they leave the memory.
        """
        self.published(MEMORY, offset, len(data))
        self._forces[offset] = bytes(data)

    def unforce(self, offset: int) -> None:
        """End the force at an offset; without one, nothing happens."""
        self._forces.pop(offset, None)

    @property
    def forces(self) -> dict[int, bytes]:
        """The forces in effect: memory offset to bytes."""
        return dict(self._forces)

    def waiting_writes(self, without: str) -> tuple[Waiting, ...]:
        """Return what waits for the next scan, in order, without the writes of one client."""
        return tuple(Waiting(w.port.name, w.area, w.offset, w.data, w.mask) for w in self._queue
                     if w.port.name != without)

    def checkpoint(self) -> Checkpoint:
        """Return image and forces, to which an exchange of the same program can return."""
        return Checkpoint(b"".join(self._image.values()), dict(self._forces))

    def return_to(self, point: Checkpoint) -> None:
        """Take up image and forces of a checkpoint; the writes that wait are forgotten.

        Memory is as it was then, too: nothing is published before the next scan.
        """
        for write in self._queue:
            write.port.latched()
        self._queue = []
        begin = 0
        for image in self._image.values():
            image[:] = point.image[begin:begin + len(image)]
            begin += len(image)
        self._forces = dict(point.forces)
        self._shown = bytearray()

    def rebind(self, memory: bytearray | memoryview, extents: Sequence[Extent],
               place: Callable[[int, int], int | None]) -> list[int]:
        """Go on over the memory of an edited program, between two scans; ports stay as they are.

        The image stays what it is. Waiting writes must have been latched before.

        Args:
            memory: the new block.
            extents: the stretches of the areas that stand in it.
            place: where bytes of the old block (offset, count) stand in the new one, or None.

        Returns:
            The old offsets of forces that have no place any more; they end.
        """
        forces, ended = {}, []
        for offset, data in self._forces.items():
            new = place(offset, len(data))
            if new is None:
                new = _same_element(offset, self._extents, extents)
            if new is None:
                ended.append(offset)
            else:
                forces[new] = data
        self._forces = forces
        self._stand_over(memory, extents)
        return ended

    def update_inputs(self) -> None:
        """Latch all waiting writes together into image and memory, then the forces."""
        self.writers = set()
        if self._queue:
            waiting, self._queue = self._queue, []
            for write in waiting:
                self._latch(write)
                if write.area[0] == "I":
                    self.writers.add(write.port.name)
            for port in {write.port for write in waiting}:
                port.latched()
        if self._forces:
            self._apply_forces()

    def _latch(self, write: _Write) -> None:
        """Put a write into the image and, where the program uses it, into memory.

        Around the written bits the elements keep what memory holds, not what was last published.
        """
        _, area, offset, data, mask = write
        if area == MEMORY:
            _merge(self._memory, offset, data, mask)
            return
        parts, whole = self._targets.get((area, offset, len(data))) or \
            self._target(area, offset, len(data))
        image, memory, shown = self._image[area], self._memory, self._shown
        if mask is None:
            if not whole:
                for part in parts:
                    image[part.in_image] = part.to_image(bytes(memory[part.in_memory]))
            image[offset:offset + len(data)] = data
        else:
            for part in parts:
                image[part.in_image] = part.to_image(bytes(memory[part.in_memory]))
            _merge(image, offset, data, mask)
        for in_memory, in_image, _, to_memory in parts:
            raw = memory[in_memory] = to_memory(bytes(image[in_image]))
            if shown:
                shown[in_memory] = raw  # here image and memory say the same now
        if area[0] != "I":
            self.version += 1

    def _target(self, area: str, offset: int, n: int) -> _Target:
        """Find what a write of `n` bytes touches; the same few come again and again."""
        if len(self._targets) >= TARGETS_LIMIT:
            self._targets.clear()
        found = [self._extents[k].part(offset, offset + n) for k in self._by_area.get(area, ())]
        parts = tuple(_part(part) for part in found if part is not None)
        whole = all(offset <= part.in_image.start and part.in_image.stop <= offset + n
                    for part in parts)
        target = self._targets[area, offset, n] = _Target(parts, whole)
        return target

    def update_outputs(self) -> None:
        """Publish what the scan left in memory, forces over it."""
        if self._forces:
            self._apply_forces()
        shown, now = self._shown, bytes(self._memory[:self._end])
        if now == shown:
            return
        for area, part in self._parts:
            raw = now[part.in_memory]
            if raw != shown[part.in_memory]:
                self._image[area][part.in_image] = part.to_image(raw)
                self.version += 1
        self._shown = bytearray(now)

    def _apply_forces(self) -> None:
        for offset, data in self._forces.items():
            self._memory[offset:offset + len(data)] = data
