"""Which cells of memory a WebAssembly local holds a copy of, at the place that is being written.

A cell that was loaded or stored need not be loaded again until something may have changed it. Every
store still goes to memory, so that memory is right at any instant, a fault's too. Where ways meet,
what all of them hold is held.
"""

from __future__ import annotations

from plcemu.ir.ops import SIZES

LIMIT = 16
"""Cells held at a time; the oldest gives way."""

WIDEST = max(SIZES.values())

_Held = dict[tuple[str, int], tuple[str, bool]]
"""Base and offset of a cell to its machine type, and whether the local's value is raw."""


class Cells:
    """Follows the code as it is written, statement by statement."""

    def __init__(self) -> None:
        self._held: _Held = {}
        self._at: dict[str, _Held] = {}
        self._bases: set[str] = set()

    def find(self, base: str, offset: int, machine: str) -> bool | None:
        """Return whether the local's value is raw; None if no local holds the cell."""
        entry = self._held.get((base, offset))
        return entry[1] if entry and entry[0] == machine else None

    def loaded(self, base: str, offset: int, machine: str, raw: bool) -> None:
        """A local now holds what the cell holds."""
        if len(self._held) >= LIMIT:
            del self._held[next(iter(self._held))]
        self._held[base, offset] = machine, raw
        self._bases.add(base)

    def stored(self, base: str, offset: int, machine: str, raw: bool) -> None:
        """A cell has a new value, and a local holds it too; what overlaps it is forgotten."""
        held, size = self._held, SIZES[machine]
        for at in range(offset - WIDEST + 1, offset + size):
            entry = held.get((base, at))
            if entry and at + SIZES[entry[0]] > offset:
                del held[base, at]
        if self._bases - {base}:
            # An instance may lie anywhere in memory, so an offset from it may be any cell.
            self._held = {cell: entry for cell, entry in held.items() if cell[0] == base}
            self._bases = {base}
        self.loaded(base, offset, machine, raw)

    def forget(self) -> None:
        """Anything may have changed."""
        self._held, self._bases = {}, set()

    def jump(self, label: str) -> None:
        """A jump goes from here to a label further on."""
        before = self._at.get(label)
        self._at[label] = dict(self._held) if before is None else _common(before, self._held)

    def meet(self, label: str, falls: bool) -> None:
        """Here is a label; `falls` tells whether the code before it runs into it."""
        came = self._at.pop(label, None)
        if came is not None:
            self._held = _common(came, self._held) if falls else came
            self._bases = {base for base, _ in self._held}


def _common(one: _Held, other: _Held) -> _Held:
    found: _Held = {}
    for cell, (machine, raw) in one.items():
        entry = other.get(cell)
        if entry and entry[0] == machine:
            found[cell] = machine, raw or entry[1]
    return found
