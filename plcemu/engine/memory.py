"""The memory block of one resource, with its tags and clock cells."""

from __future__ import annotations

from plcemu.base.tags import TagTable
from plcemu.base.trace import Change
from plcemu.base.types import ElementaryType, StringType, Value, type_of
from plcemu.ir.program import Block, Layout


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
        idle = {clock.offset for clock in layout.clocks if not clock.observed}
        self._owner = self._owners(idle)
        self._shown = bytes(self.block)

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

    def values(self) -> tuple[Change, ...]:
        """Return all tags with their values, as in the first frame of a trace."""
        self._shown = bytes(self.block)
        return tuple((i, row.unpack(self.block, offset))
                     for i, (offset, row) in enumerate(self._slots))

    def changes(self) -> tuple[Change, ...]:
        """Return the tags that changed since the last call (or `values`), with their values."""
        now = bytes(self.block)
        if now == self._shown:
            return ()
        found = {tag for byte in differing_bytes(self._shown, now)
                 for tag in self._owner.get(byte, ())}
        self._shown = now
        return tuple((i, self.read(i)) for i in sorted(found))

    @property
    def shown(self) -> bytes:
        """The block as `values` or `changes` last told it; set to tell from there on."""
        return self._shown

    @shown.setter
    def shown(self, block: bytes) -> None:
        self._shown = block


def differing_bytes(before: bytes, after: bytes) -> list[int]:
    """Return the offsets at which two blocks of equal length differ."""
    found: list[int] = []
    chunk = 64
    for start in range(0, len(after), chunk):
        a, b = before[start:start + chunk], after[start:start + chunk]
        if a != b:
            found.extend(start + i for i, (x, y) in enumerate(zip(a, b, strict=True)) if x != y)
    return found
