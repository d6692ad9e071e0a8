"""The memory block of one resource, with its tags and clock cells."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterable

from plcemu.base.tags import TagTable
from plcemu.base.trace import Change
from plcemu.base.types import ElementaryType, StringType, Value, type_of
from plcemu.ir.program import Block, Layout

_CLOCK = struct.Struct("<qq")

_Place = tuple[int, Callable[[Block, int], tuple[Value]], int]
_KNOWN_LIMIT = 4096
"""Differences between two images whose tags are remembered; then they are found anew."""
_KNOWN_BELOW = 1 << 8 * 64
"""Only differences within 64 bytes are remembered."""


class Memory:
    """One flat block of bytes; snapshot, restore and compare are operations on it.

    Args:
        layout: what stands where.
        block: an engine's memory.

    Attributes:
        block: the bytes, little-endian. It is never replaced, so views of it stay valid.
        tags: the tags that stand in it.
    """

    def __init__(self, layout: Layout, block: Block) -> None:
        self.layout = layout
        self.block = block
        self.tags = TagTable(slot.tag for slot in layout.slots)
        self._slots: list[tuple[int, ElementaryType | StringType]] = [
            (slot.offset, type_of(slot.tag.type)) for slot in layout.slots]
        self._readers = [(_reader(row), offset) for offset, row in self._slots]
        idle = {clock.offset for clock in layout.clocks if not clock.observed}
        self._read = [clock for clock in layout.clocks if clock.observed]
        passing = [offset for clock in self._read if clock.expiry is not None
                   for offset in (clock.offset, clock.expiry.copy)]
        self.reads_clocks = bool(self._read)
        """Whether the program reads a clock cell."""
        self._told = _all_but(idle, len(block))
        self._lasting = _all_but(passing, len(block)) if passing else None
        copies = {clock.expiry.copy for clock in self._read if clock.expiry is not None}
        self.elapsed_tags = frozenset(
            i for i, (offset, _) in enumerate(self._slots) if offset in copies)
        """The tags that show elapsed times which the program does not read."""
        self.idle_tags = frozenset(
            i for i, (offset, _) in enumerate(self._slots) if offset in idle)
        """The tags of clocks that the program does not read: they run without being a change."""
        self._owner = self._owners(idle)
        self._known: dict[tuple[int, int], list[_Place]] = {}
        self._shown = self._now()

    def _owners(self, idle: set[int]) -> dict[int, list[int]]:
        """Map each byte to the tags it belongs to; clocks that nothing reads change unseen."""
        owners: dict[int, list[int]] = {}
        for index, (offset, row) in enumerate(self._slots):
            if offset not in idle:
                for byte in range(offset, offset + row.size):
                    owners.setdefault(byte, []).append(index)
        return owners

    def cold_start(self) -> None:
        """Set everything to its initial value."""
        self.block[:] = self.layout.initial

    def snapshot(self) -> bytes:
        """Return the whole state."""
        return bytes(self.block)

    def restore(self, image: bytes) -> None:
        """Set the whole state.

        Raises:
            ValueError: the image is of another layout.
        """
        if len(image) != len(self.block):
            raise ValueError(f"the image has {len(image)} bytes, this program's memory "
                             f"{len(self.block)}; it is of another program")
        self.block[:] = image

    def read(self, index: int) -> Value:
        """Return the value of a tag by its index."""
        offset, row = self._slots[index]
        return row.unpack(self.block, offset)

    def place(self, index: int) -> tuple[int, ElementaryType | StringType]:
        """Return a tag's offset in the block and its type."""
        return self._slots[index]

    def _now(self) -> int:
        """Return the block, without clocks that the program does not read, as one number."""
        return int.from_bytes(self.block, "little") & self._told

    def values(self) -> tuple[Change, ...]:
        """Return all tags with their values, as in the first frame of a trace."""
        self._shown = self._now()
        return tuple((i, row.unpack(self.block, offset))
                     for i, (offset, row) in enumerate(self._slots))

    def changes(self) -> tuple[Change, ...]:
        """Return the tags that changed since the last call (or `values`), with their values."""
        before, self._shown = self._shown, self._now()
        difference = before ^ self._shown
        if not difference:
            return ()
        block = self.block
        # Mostly a few neighbouring bytes differ, and the same bits of them again and again.
        first = (difference & -difference).bit_length() - 1 >> 3
        stretch = difference >> 8 * first
        changed = self._known.get((first, stretch))
        if changed is None:
            changed = self._changed(first, stretch)
        return tuple([(i, unpack(block, offset)[0]) for i, unpack, offset in changed])

    def _changed(self, first: int, stretch: int) -> list[_Place]:
        """Return index, reader and offset of the tags whose bytes differ, from a byte on."""
        found: set[int] = set()
        for byte in _set_bytes(stretch):
            found.update(self._owner.get(first + byte, ()))
        changed = [(i, *self._readers[i]) for i in sorted(found)]
        if stretch < _KNOWN_BELOW:
            if len(self._known) >= _KNOWN_LIMIT:
                self._known.clear()
            self._known[first, stretch] = changed
        return changed

    @property
    def shown(self) -> bytes:
        """The block as `values` or `changes` last told it; set to tell from there on."""
        return self._shown.to_bytes(len(self.block), "little")

    @shown.setter
    def shown(self, block: bytes) -> None:
        self._shown = int.from_bytes(block, "little")

    def time_matters_in_ns(self) -> int | None:
        """Return how much time may pass before that alone can change what a scan does.

        None is any time: no clock cell runs that the program reads. 0 is none: it reads one that
        runs. In between, of all that run it can only see that they expire.
        """
        soonest = None
        for clock in self._read:
            elapsed, limit = _CLOCK.unpack_from(self.block, clock.offset)
            if elapsed < limit:
                if clock.expiry is None or self.block[clock.expiry.varied]:
                    return 0
                if soonest is None or limit - elapsed < soonest:
                    soonest = limit - elapsed
        return soonest

    def differ_in_elapsed_only(self, before: bytes, after: bytes) -> bool:
        """Whether two images differ at most in elapsed times of which only the expiry is seen."""
        if self._lasting is None:
            return False
        differing = int.from_bytes(before, "little") ^ int.from_bytes(after, "little")
        return not differing & self._lasting


def _reader(row: ElementaryType | StringType) -> Callable[[Block, int], tuple[Value]]:
    """Return what unpacks a type's value from a block, as a tuple of one."""
    if isinstance(row, StringType):
        return lambda data, offset: (row.unpack(data, offset),)
    unpack: Callable[[Block, int], tuple[Value]] = struct.Struct("<" + row.code).unpack_from
    return unpack


_NOT_ZERO = re.compile(rb"[^\0]+")


def _all_but(cells: Iterable[int], size: int) -> int:
    """Return a mask of a block's bytes, without the 64-bit cells at these offsets."""
    mask = bytearray(b"\xff" * size)
    for offset in cells:
        mask[offset:offset + 8] = bytes(8)
    return int.from_bytes(mask, "little")


def differing_bytes(before: bytes, after: bytes) -> list[int]:
    """Return the offsets at which two blocks of equal length differ."""
    difference = int.from_bytes(before, "little") ^ int.from_bytes(after, "little")
    return _set_bytes(difference)


def _set_bytes(number: int) -> list[int]:
    """Return the places of the bytes of a number that are not zero, the lowest first."""
    raw = number.to_bytes(number.bit_length() + 7 >> 3, "little")
    return [byte for run in _NOT_ZERO.finditer(raw) for byte in range(*run.span())]
