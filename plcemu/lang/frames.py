"""The user's functions: their blocks, and where their frames stand in memory."""

from __future__ import annotations

from collections.abc import Iterable

from plcemu.lang.types import BlockType, default_bytes


class Functions:
    """Gives each function's frame a place, one after another from an offset on.

    Args:
        blocks: the functions' layouts.
        begin: where the first frame begins in memory.
        bases: where the program instances before it begin.
    """

    def __init__(self, blocks: Iterable[BlockType], begin: int,
                 bases: Iterable[int] = ()) -> None:
        self._blocks: dict[str, BlockType] = {}
        self._frames: dict[str, int] = {}
        self.end = begin
        self.bases = tuple(bases)
        self._constants: dict[bytes, int] = {}
        self.initial: list[tuple[int, bytes]] = []
        for block in blocks:
            self._blocks[block.name.upper()] = block
            self._frames[block.name.upper()] = self.end
            self.initial.append((self.end, default_bytes(block)))  # its constants stay as they are
            self.end += block.size

    def allocate(self, data: bytes) -> int:
        """Return the place of constant bytes in memory, behind the frames."""
        if data not in self._constants:
            self._constants[data] = self.temporary(len(data))
            self.initial.append((self._constants[data], data))
        return self._constants[data]

    def temporary(self, size: int) -> int:
        """Return the place of fresh bytes that the code may write, such as a string's."""
        place = self.end
        self.end += -(-size // 8) * 8
        return place

    def block(self, name: str) -> BlockType | None:
        """Return the layout of a user's function, or None if there is none of that name."""
        return self._blocks.get(name.upper())

    def frame(self, name: str) -> int:
        """Return where a function's frame begins in memory."""
        return self._frames[name.upper()]

    @property
    def names(self) -> list[str]:
        """The functions' names, in the user's spelling."""
        return [block.name for block in self._blocks.values()]
