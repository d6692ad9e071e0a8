"""Quantities as users write them: durations, shares, factors, texts; each says what it expects."""

from __future__ import annotations

from fractions import Fraction
from typing import Annotated

from pydantic import BeforeValidator, Field

from plcemu.base.time import DurationError, parse_duration_ns

DIGITS_LIMIT = 40
"""Characters of a factor; more, or a huge exponent, is a slip and would take ages to compute."""


def _duration(value: object) -> int:
    """Read a duration; a bare number has no unit and is refused."""
    try:
        if isinstance(value, str):
            return parse_duration_ns(value)
    except (DurationError, ValueError):
        pass
    raise ValueError("a number with a unit of d, h, min, s, ms, us or ns, such as 10ms")


def _not_negative(value: object) -> int:
    t_ns = _duration(value)
    if t_ns < 0:
        raise ValueError("a duration of 0 or more")
    return t_ns


def _positive(value: object) -> int:
    t_ns = _duration(value)
    if t_ns <= 0:
        raise ValueError("a duration of more than 0")
    return t_ns


def _percent(value: object) -> Fraction:
    text, mistake = str(value).strip(), ValueError("a part of the cycle from 0 % to 90 %, "
                                                   "such as 0.5 %")
    if not text.endswith("%") or len(text) > DIGITS_LIMIT or "e" in text.lower():
        raise mistake
    try:
        part = Fraction(text[:-1].strip()) / 100
    except (ValueError, ZeroDivisionError):
        raise mistake from None
    if not 0 <= part <= Fraction(9, 10):
        raise mistake
    return part


def _factor(value: object) -> Fraction:
    text, mistake = str(value), ValueError("a number between 1e-9 and 1e9")
    exponent = text.lower().partition("e")[2].lstrip("+-")
    if len(text) > DIGITS_LIMIT or len(exponent) > 2:
        raise mistake
    try:
        factor = Fraction(text)
    except (ValueError, ZeroDivisionError):
        raise mistake from None
    if not Fraction(1, 10**9) <= factor <= 10**9:
        raise mistake
    return factor


def _optional_factor(value: object) -> Fraction | None:
    return None if value is None else _factor(value)


def _number(value: object) -> object:
    if not isinstance(value, bool | int | float):
        raise ValueError("true, false or a number")
    return value


def _texts(value: object) -> object:
    return [value] if isinstance(value, str) else value


def _listed(value: object) -> object:
    """Take a list or a number for the text of what is varied."""
    return ", ".join(map(str, value)) if isinstance(value, list) else _text(value)


def _text(value: object) -> object:
    """Take a number for a text where a text is wanted: a name such as 7 needs no quotes."""
    return str(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Duration = Annotated[int, BeforeValidator(_not_negative)]
PositiveDuration = Annotated[int, BeforeValidator(_positive)]
Factor = Annotated[Fraction, BeforeValidator(_factor)]
Percent = Annotated[Fraction, BeforeValidator(_percent)]
Texts = Annotated[list[str], BeforeValidator(_texts)]
Number = Annotated[bool | int | float, BeforeValidator(_number)]
OptionalFactor = Annotated[Fraction | None, BeforeValidator(_optional_factor)]
Text = Annotated[str, BeforeValidator(_text)]
TextOfList = Annotated[str, BeforeValidator(_listed)]
Unit = Annotated[int, Field(ge=0, le=255)]
Budget = Annotated[int, Field(ge=1, le=10**15)]
