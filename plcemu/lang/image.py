"""The process image in memory: which of its stretches a program uses, and where they stand."""

from __future__ import annotations

from collections.abc import Iterable

from plcemu.base.areas import SIZES, Address, parse_address
from plcemu.base.spans import Span
from plcemu.ir.program import ImageExtent
from plcemu.lang.lexer import Token
from plcemu.lang.report import Report

_GAP = 64
"""Unused elements between two used ones that still share an extent of the image."""


class Image:
    """The stretches of the process image that a program uses, at the start of memory.

    Attributes:
        extents: the stretches.
        missing: what `stretch` was asked for in vain; an image with these is to be made instead.
        size: bytes of all stretches.
    """

    def __init__(self, addresses: Iterable[Address]) -> None:
        used: dict[str, list[int]] = {}
        for address in addresses:
            used.setdefault(address.area, []).append(address.index)
        self.extents: list[ImageExtent] = []
        self.missing: list[Address] = []
        self.size = 0
        for area in sorted(used):
            for first, last in _runs(sorted(set(used[area])), area[1] == "X"):
                width = SIZES[area[1]]
                self.size = -(-self.size // width) * width
                self.extents.append(ImageExtent(area, first, last - first + 1, self.size))
                self.size += (last - first + 1) * width

    def offset(self, address: Address) -> int:
        """Return where an address stands in memory; it must be one given to the constructor."""
        for extent in self.extents:
            if extent.area == address.area and 0 <= address.index - extent.first < extent.count:
                return extent.offset + (address.index - extent.first) * SIZES[address.area[1]]
        raise KeyError(str(address))

    def stretch(self, address: Address, count: int) -> int:
        """Return where so many elements stand; if they are not in one extent they are `missing`."""
        for extent in self.extents:
            first = address.index - extent.first
            if extent.area == address.area and first >= 0 and first + count <= extent.count:
                return extent.offset + first * SIZES[address.area[1]]
        self.missing += [Address(address.area, address.index + n) for n in range(count)]
        return 0


def _runs(indices: list[int], bits: bool) -> list[tuple[int, int]]:
    """Join sorted indices into (first, last) runs; runs of bits begin and end at whole bytes."""
    runs: list[tuple[int, int]] = []
    for index in indices:
        first, last = (index // 8 * 8, index // 8 * 8 + 7) if bits else (index, index)
        if runs and first - runs[-1][1] <= _GAP:
            runs[-1] = (runs[-1][0], max(last, runs[-1][1]))
        else:
            runs.append((first, last))
    return runs


def name_key(name: str) -> str:
    """Return a name as scopes know it: in capitals, a direct address in its usual form."""
    try:
        return str(parse_address(name)) if name.startswith("%") else name.upper()
    except ValueError:
        return name.upper()


def read_address(text: str, span: Span, report: Report) -> Address | None:
    """Read an address; a mistake goes to the report."""
    try:
        return parse_address(text)
    except ValueError as problem:
        report.error("P0030", span, str(problem))
        return None


def addresses_in(tokens: Iterable[Token]) -> list[Address]:
    """Return the valid addresses among tokens; mistakes are reported where they are used."""
    found = []
    for token in tokens:
        if token.kind == "direct":
            try:
                found.append(parse_address(token.text))
            except ValueError:
                continue
    return found
