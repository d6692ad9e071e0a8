"""Points: values in engineering units become raw counts and back."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.base.areas import parse_address
from plcemu.io.exchange import Exchange
from plcemu.io.mapping import Point, PointError


def point(address, scale=1):
    return Point("p", parse_address(address), Fraction(scale))


@given(st.sampled_from(["%IB3", "%IW5", "%MD1", "%QL7"]), st.data())
def test_counts_go_through_the_image_unchanged(address, data):
    place = point(address)
    half = 1 << 8 * place.width - 1
    value = data.draw(st.integers(-half, half - 1))
    exchange = Exchange(bytearray())
    exchange.port("x").write(*place.image_write(place.to_raw(value)))
    exchange.update_inputs()
    raw = place.from_image(exchange.published(*place.image_place()))
    assert raw == value % (1 << 8 * place.width)
    assert place.to_value(raw) == float(value)


@given(st.integers(0, 8191), st.booleans())
def test_a_bit_goes_to_its_own_place_only(index, value):
    place = point(f"%IX{index // 8}.{index % 8}")
    exchange = Exchange(bytearray())
    client = exchange.port("x")
    client.write("IX", 0, b"\xff" * 1024 if not value else b"\x00" * 1024)
    client.write(*place.image_write(place.to_raw(value)))
    exchange.update_inputs()
    image = int.from_bytes(exchange.published("IX", 0, 1024), "little")
    others = (1 << 8192) - 1 if not value else 0
    assert image == others ^ (1 << index)
    assert place.from_image(exchange.published(*place.image_place())) == value


@pytest.mark.parametrize(("address", "scale", "value", "raw"), [
    ("%IW0", "1/10", 4.2, 42), ("%IW0", "1/10", -0.1, 0xFFFF), ("%IW0", 1, 0.5, 0),
    ("%IW0", 1, 1.5, 2), ("%IW0", 1, 40000, 32767), ("%IW0", 1, -40000, 0x8000),
    ("%IB0", 1, 200, 127),
    ("%IW0", 1, math.inf, 32767), ("%IW0", "1/3", -math.inf, 0x8000),
    ("%IW0", -1, math.inf, 0x8000),
    ("%IX0.0", 1, 7, 1), ("%IX0.0", 1, 0.0, 0), ("%ID0", "1/1000", 1e300, 0x7FFFFFFF)])
def test_values_round_and_saturate(address, scale, value, raw):
    assert point(address, scale).to_raw(value) == raw


def test_what_is_not_a_number_has_no_raw_value():
    with pytest.raises(PointError, match="p is not a number"):
        point("%IW0").to_raw(math.nan)
