"""What a sweep varies: lists, grids and ranges of the values of a key of the configuration."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

from plant_sim.chance import uniform
from plcemu.base.errors import PlcemuError
from plcemu.base.time import UNITS_NS, DurationError, format_duration, parse_duration_ns

GRID_LIMIT = 1_000_000
"""Values of one grid."""

_QUANTITY = re.compile(r"([+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d{1,2})?)\s*([^\d\s.]*)")

SYNTAX = ("NAME=5,7.5,9 (a list), NAME=5ms..15ms:0.1ms (a grid: from, to, step) or NAME=195..205 "
          "(a range, from which each run draws)")


class VariationError(PlcemuError):
    """A text does not say what is to be varied."""

    def __init__(self, text: str, problem: str) -> None:
        super().__init__(f"--vary {text}: {problem}; write {SYNTAX}")


@dataclass(frozen=True, slots=True)
class Variation:
    """A key of the configuration and its values.

    Attributes:
        name: of the key, as for `--set`.
        values: one after another; empty for a range.
        low, high: ends of a range, in `unit` or, for durations, in ns.
        unit: written after the number; `ns` for every duration.
    """

    name: str
    values: tuple[str, ...] = ()
    low: Decimal = Decimal(0)
    high: Decimal = Decimal(0)
    unit: str = ""

    @property
    def is_range(self) -> bool:
        """Whether each run draws a value."""
        return not self.values

    @property
    def ends(self) -> tuple[str, str]:
        """The ends of the range."""
        return _text(self.low, self.unit), _text(self.high, self.unit)

    def draw(self, seed: int, *key: str | int) -> str:
        """Return the value that a run draws from the range; the same for the same seed and key."""
        part = uniform(seed, "vary", self.name, *key)
        if self.unit == "ns":
            return format_duration(round(int(self.low) + part * int(self.high - self.low)))
        value = float(self.low) + part * float(self.high - self.low)
        return f"{value:.12g}{self.unit}"


def parse_variation(text: str) -> Variation:
    """Read `NAME=SPEC`.

    Raises:
        VariationError: it is malformed.
    """
    name, equals, spec = (part.strip() for part in text.partition("="))
    if not (name and equals and spec):
        raise VariationError(text, "found no name and values")
    if ".." not in spec:
        values = tuple(each.strip() for each in spec.split(","))
        if not all(values):
            raise VariationError(text, "found an empty value in the list")
        return Variation(name, values)
    ends, _, step = spec.partition(":")
    low, high = (_quantity(text, end) for end in ends.split("..", 1))
    if low[1] != high[1]:
        raise VariationError(text, f"found units {low[1] or 'none'} and {high[1] or 'none'}")
    if low[0] > high[0]:
        raise VariationError(text, "found a first value above the last")
    if not step:
        return Variation(name, (), low[0], high[0], low[1])
    by = _quantity(text, step)
    if by[1] != low[1] or by[0] <= 0:
        raise VariationError(text, f"found the step {step.strip()!r}")
    count = int((high[0] - low[0]) / by[0]) + 1
    if count > GRID_LIMIT:
        raise VariationError(text, f"found {count} values, more than {GRID_LIMIT}")
    return Variation(name, tuple(_text(low[0] + n * by[0], low[1]) for n in range(count)))


def _quantity(text: str, quantity: str) -> tuple[Decimal, str]:
    """Return number and unit; durations as ns."""
    match = _QUANTITY.fullmatch(quantity.strip())
    if match is None:
        raise VariationError(text, f"found {quantity.strip()!r} where a number was expected")
    try:
        if match[2].lower() in UNITS_NS:
            return Decimal(parse_duration_ns(quantity.strip())), "ns"
        return Decimal(match[1]), match[2]
    except (DurationError, InvalidOperation) as problem:
        raise VariationError(text, str(problem)) from None


def _text(value: Decimal, unit: str) -> str:
    if unit == "ns":
        return format_duration(int(value))
    return f"{value.normalize():f}{unit}"


def magnitude(text: str, value: str) -> tuple[float, str]:
    """Return a value as a number and its unit, durations in s, to be drawn.

    Raises:
        VariationError: it is no number; `text` is the variation that it is of.
    """
    number, unit = _quantity(text, value)
    return (float(number) / 1e9, "s") if unit == "ns" else (float(number), unit)
