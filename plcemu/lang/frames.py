"""The user's functions: their blocks, and where their frames stand in memory."""

from __future__ import annotations

from collections.abc import Iterable

from plcemu.lang.types import BlockType


class Functions:
    """Gives each function's frame a place, one after another from an offset on.

    Args:
        blocks: the functions' layouts.
        begin: where the first frame begins in memory.
    """

    def __init__(self, blocks: Iterable[BlockType], begin: int) -> None:
        self._blocks: dict[str, BlockType] = {}
        self._frames: dict[str, int] = {}
        self.end = begin
        for block in blocks:
            self._blocks[block.name.upper()] = block
            self._frames[block.name.upper()] = self.end
            self.end += block.size

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
