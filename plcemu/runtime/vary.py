"""Variations: `NAME=FROM..TO:STEP` or `NAME=A,B,C`, the values that a parameter runs through.

Every value is a text as `--set NAME=VALUE` takes it, made with exact numbers: 0..1:0.1 has eleven
values, and the fourth is 0.3.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from plcemu.base.errors import PlcemuError
from plcemu.base.time import DurationError, format_duration, parse_duration_ns

VALUES_LIMIT = 1_000_000
"""Values that one variation may have."""

_NUMBER = re.compile(r"[+-]?\d{1,30}(\.\d{1,30})?")
_FORM = "NAME=FROM..TO:STEP, such as cycle=1ms..15ms:10us, or NAME=A,B,C"


class VariationError(PlcemuError):
    """A text is no variation."""


@dataclass(frozen=True, slots=True)
class Variation:
    """A parameter and the values it runs through, as texts."""

    name: str
    values: tuple[str, ...]


def parse_variation(text: str) -> Variation:
    """Read a variation.

    Raises:
        VariationError: what is wrong with it, and what was expected.
    """
    name, equals, what = (part.strip() for part in text.partition("="))
    if not equals or not name or not what:
        raise VariationError(f"found {text!r}, expected {_FORM}")
    if ".." not in what:
        values = tuple(part.strip() for part in what.split(","))
        if not all(values):
            raise VariationError(f"{text!r} has an empty value; expected {_FORM}")
        return Variation(name, values)
    span, colon, step = what.partition(":")
    low, _, high = span.partition("..")
    if not colon:
        raise VariationError(f"{text!r} has no step; expected {_FORM}")
    return Variation(name, _range(text, *(part.strip() for part in (low, high, step))))


def magnitude(value: str) -> tuple[float, str]:
    """Return a value as a number and its unit (s for a duration), to be drawn.

    Raises:
        VariationError: it is no number.
    """
    if _NUMBER.fullmatch(value):
        return float(value), ""
    try:
        return parse_duration_ns(value) / 1e9, "s"
    except DurationError:
        raise VariationError(f"{value!r} is no number and no duration") from None


def _range(text: str, low: str, high: str, step: str) -> tuple[str, ...]:
    read, write = _kind(text, (low, high, step))
    first, last, by = read(low), read(high), read(step)
    if by <= 0 or last < first:
        raise VariationError(f"{text!r}: expected FROM not after TO and a step above 0")
    count = (last - first) // by + 1
    if count > VALUES_LIMIT:
        raise VariationError(f"{text!r} has {count} values; at most {VALUES_LIMIT} are taken")
    return tuple(write(first + n * by) for n in range(int(count)))


Reader = Callable[[str], Fraction]
Writer = Callable[[Fraction], str]


def _kind(text: str, parts: tuple[str, ...]) -> tuple[Reader, Writer]:
    """Return how the parts of a range are read and its values written: numbers or durations."""
    if all(_NUMBER.fullmatch(part) for part in parts):
        return Fraction, _decimal
    try:
        for part in parts:
            parse_duration_ns(part)
    except DurationError as problem:
        raise VariationError(f"{text!r}: expected three numbers or three durations: "
                             f"{problem}") from None
    return lambda part: Fraction(parse_duration_ns(part)), lambda t_ns: format_duration(int(t_ns))


def _decimal(value: Fraction) -> str:
    """Write a fraction whose denominator divides a power of ten."""
    digits = 0
    while (value * 10**digits).denominator != 1:
        digits += 1
    return format(Decimal(int(value * 10**digits)).scaleb(-digits), "f")
