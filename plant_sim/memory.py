"""The discrete part of a hybrid plant's state: named flags, numbers, words, rates and series.

Plain values only, so that copying is cheap and JSON can hold all of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Self


@dataclass(slots=True)
class Memory:
    """What a plant remembers besides its quantities.

    `rates` are rational numbers fixed when a mode is entered; a `series` is a sequence of numbers,
    replaced and never changed in place.
    """

    flags: dict[str, bool] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    rates: dict[str, Fraction] = field(default_factory=dict)
    series: dict[str, tuple[int, ...]] = field(default_factory=dict)

    def copy(self) -> Self:
        """An independent memory with the same content."""
        return type(self)(
            dict(self.flags),
            dict(self.numbers),
            dict(self.words),
            dict(self.rates),
            dict(self.series),
        )

    def to_json(self) -> dict[str, Any]:
        """The content as plain dictionaries and lists; a rate is [numerator, denominator]."""
        return {
            "flags": dict(self.flags),
            "numbers": dict(self.numbers),
            "words": dict(self.words),
            "rates": {k: [rate.numerator, rate.denominator] for k, rate in self.rates.items()},
            "series": {k: list(values) for k, values in self.series.items()},
        }

    @classmethod
    def from_json(cls, image: Mapping[str, Any]) -> Self:
        """The memory that `to_json` described."""
        return cls(
            dict(image["flags"]),
            dict(image["numbers"]),
            dict(image["words"]),
            {k: Fraction(*rate) for k, rate in image["rates"].items()},
            {k: tuple(values) for k, values in image["series"].items()},
        )
