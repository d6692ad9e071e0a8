"""Variations as text."""

from __future__ import annotations

import pytest

from plcemu.runtime.vary import VariationError, magnitude, parse_variation


@pytest.mark.parametrize(("text", "values"), [
    ("cycle=1ms..2ms:250us", ("1ms", "1.25ms", "1.5ms", "1.75ms", "2ms")),
    ("x = 0..1:0.3", ("0", "0.3", "0.6", "0.9")),
    ("x=-1..1:1", ("-1", "0", "1")),
    ("x=5..5:1", ("5",)),
    ("half=water, solution", ("water", "solution")),
    ("x=3", ("3",)),
])
def test_a_variation_has_exact_values(text: str, values: tuple[str, ...]) -> None:
    assert parse_variation(text).values == values


def test_tenths_add_up_without_rounding() -> None:
    assert parse_variation("x=0..1:0.1").values[3] == "0.3"
    assert len(parse_variation("x=0..1:0.1").values) == 11


@pytest.mark.parametrize(("text", "said"), [
    ("", "expected NAME="), ("x", "expected NAME="), ("=1..2:1", "expected NAME="),
    ("x=", "expected NAME="), ("x=1..2", "no step"), ("x=2..1:1", "FROM not after TO"),
    ("x=1..2:0", "above 0"), ("x=1..2ms:1", "three numbers or three durations"),
    ("x=a..b:c", "three numbers"), ("x=1,,2", "empty value"),
    ("x=0..1000000000:0.001", "at most 1000000"),
])
def test_a_text_that_is_no_variation_is_explained(text: str, said: str) -> None:
    with pytest.raises(VariationError, match=said):
        parse_variation(text)


def test_a_value_is_drawn_as_a_number() -> None:
    assert magnitude("0.5") == (0.5, "")
    assert magnitude("13.1ms") == (0.0131, "s")
    with pytest.raises(VariationError):
        magnitude("water")
