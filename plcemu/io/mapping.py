"""Points: how a plant's or a field device's values stand in the process image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

from plcemu.base.areas import SIZES, Address
from plcemu.base.errors import PlcemuError


class PointError(PlcemuError):
    """A value does not fit its place in the process image."""


@dataclass(frozen=True, slots=True)
class Point:
    """A named value at an address.

    Attributes:
        name: of the plant's port, such as `B1.level`.
        address: where its raw value stands.
        scale: engineering units for one raw count (exact); raw = round(value / scale).
        signed: whether raw values that are more than a bit are numbers in two's complement.
    """

    name: str
    address: Address
    scale: Fraction = Fraction(1)
    signed: bool = True

    @property
    def is_bit(self) -> bool:
        """Whether the raw value is one bit."""
        return self.address.area[1] == "X"

    @property
    def width(self) -> int:
        """Bytes of the raw value in the image."""
        return SIZES[self.address.area[1]]

    def to_raw(self, value: bool | int | float) -> int:
        """Return the raw value: a bit, or a number as wide as the address.

        Values beyond the range of the raw value saturate, as a real input module's do.

        Raises:
            PointError: the value is not a number.
        """
        if self.is_bit:
            return int(bool(value))
        if math.isnan(value):
            raise PointError(f"{self.name} is not a number")
        high = (1 << (8 * self.width - self.signed)) - 1
        low = -high - 1 if self.signed else 0
        if math.isinf(value):
            counts = high if (value > 0) == (self.scale > 0) else low
        else:
            counts = round(Fraction(value) / self.scale) if self.scale != 1 else round(value)
        return max(low, min(high, counts)) & ((1 << 8 * self.width) - 1)

    def to_value(self, raw: int) -> bool | float:
        """Return the value in engineering units."""
        if self.is_bit:
            return bool(raw)
        negative = self.signed and raw >> (8 * self.width - 1)
        return float((raw - (1 << 8 * self.width) if negative else raw) * self.scale)

    def image_write(self, raw: int) -> tuple[str, int, bytes, bytes | None]:
        """Return (area, byte offset, data, mask) that put a raw value into the image."""
        area, index = self.address.area, self.address.index
        width = SIZES[area[1]]
        if area[1] == "X":
            bit = 1 << index % 8
            return area, index // 8, bytes([bit if raw else 0]), bytes([bit])
        return area, index * width, raw.to_bytes(width, "big"), None

    def image_place(self) -> tuple[str, int, int]:
        """Return (area, byte offset, bytes) of the value in the image."""
        index = self.address.index
        return self.address.area, index // 8 if self.is_bit else index * self.width, self.width

    def from_image(self, data: bytes) -> int:
        """Return the raw value from the image's bytes."""
        if self.is_bit:
            return data[0] >> self.address.index % 8 & 1
        return int.from_bytes(data, "big")
