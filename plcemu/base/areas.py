"""The areas of the process image and the addresses of directly represented variables.

As in OpenPLC, each combination of location (I, Q, M) and size (X, B, W, D, L) is an area of its own
with `AREA_ELEMENTS` elements: `%QX0.0` is not part of `%QW0`. An area X has eight bits an element.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

AREA_ELEMENTS = 1024
"""Elements in each area (bytes, for the areas of bits)."""

LOCATIONS = {"I": "input", "Q": "output", "M": "marker"}
SIZES = {"X": 1, "B": 1, "W": 2, "D": 4, "L": 8}
"""Bytes an element takes in the image, by size letter; X holds eight bits in a byte."""

AREAS: dict[str, int] = {loc + size: AREA_ELEMENTS * width
                         for loc in LOCATIONS for size, width in SIZES.items()}
"""Bytes of each area's image, by its two letters, such as `QX` or `IW`."""

_ADDRESS = re.compile(r"%([IQM])([XBWDL]?)(\d+)(?:\.(\d+))?", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True, slots=True)
class Address:
    """A directly represented variable.

    Attributes:
        area: two letters, such as `QX`.
        index: the element; in an area X the bit, byte·8 + bit.
    """

    area: str
    index: int

    def __str__(self) -> str:
        if self.area[1] == "X":
            return f"%{self.area}{self.index // 8}.{self.index % 8}"
        return f"%{self.area}{self.index}"


def parse_address(text: str) -> Address:
    """Read `%IX0.3`, `%Q0.3`, `%MW12` and the like (IEC 61131-3, 2.4.1.1).

    Raises:
        ValueError: with what is wrong and what is expected.
    """
    match = _ADDRESS.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{text!r} is not an address; write %IX0.0, %QW3, %MD1 and the like")
    location, size = match[1].upper(), match[2].upper() or "X"
    element, bit = int(match[3]), match[4]
    if element >= AREA_ELEMENTS:
        raise ValueError(f"{text!r} is outside the process image; elements go from 0 to "
                         f"{AREA_ELEMENTS - 1}")
    if size != "X":
        if bit is not None:
            raise ValueError(f"{text!r} names a bit of an element; only X areas have bits")
        return Address(location + size, element)
    if match[2] == "" and bit is None:
        raise ValueError(f"{text!r} names no size; write %{location}X{element}.0 for a bit")
    if int(bit or 0) > 7:
        raise ValueError(f"{text!r} has no such bit; bits go from 0 to 7")
    return Address(location + size, element * 8 + int(bit or 0))
