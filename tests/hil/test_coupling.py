"""A plant coupled to a process image: scaling, saturation, time."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_plant import ToyPlant

from hil.coupling import Coupling, CouplingError, points
from plcemu.base.areas import parse_address
from plcemu.io.mapping import Point

ONE = Fraction(1)


def point(address: str, scale: str = "1") -> Point:
    return Point("x", parse_address(address), Fraction(scale))


# points


@pytest.mark.parametrize(("address", "scale", "value", "raw"), [
    ("%IW0", "0.1", 4.2, 42), ("%IW0", "0.1", 0.1, 1), ("%IW0", "0.1", 0.30000000000000004, 3),
    ("%IW0", "0.1", -0.1, 0xFFFF), ("%IW0", "1", 2.5, 2), ("%IW0", "1", 3.5, 4),
    ("%IW0", "1/3", 1, 3), ("%IB0", "1", 100, 100), ("%ID0", "0.001", -1.0, 2**32 - 1000),
    ("%IL0", "1", 2**62, 2**62), ("%IX0.0", "7", True, 1), ("%IX0.0", "1", 0.0, 0),
])
def test_a_value_becomes_whole_counts(address: str, scale: str, value: float, raw: int) -> None:
    assert point(address, scale).to_raw(value) == raw


@pytest.mark.parametrize(("address", "bits"), [("%IB0", 8), ("%IW0", 16), ("%ID0", 32),
                                               ("%IL0", 64)])
def test_a_value_out_of_range_saturates(address: str, bits: int) -> None:
    made = point(address, "0.1")
    high = 2 ** (bits - 1) - 1
    assert made.to_raw(1e30) == made.to_raw(float("inf")) == high
    assert made.to_raw(-1e30) == made.to_raw(float("-inf")) == high + 1


@given(st.integers(-2**31, 2**31 - 1), st.sampled_from(["1", "0.1", "1/3", "0.25", "1000"]))
def test_every_raw_value_comes_back_from_its_value(counts: int, scale: str) -> None:
    made, raw = point("%ID0", scale), counts & 0xFFFFFFFF
    assert made.to_raw(made.to_value(raw)) == raw


@given(st.integers(-10**6, 10**6), st.sampled_from(["0.1", "0.01", "0.001"]))
def test_decimals_of_a_sensor_are_exact(counts: int, scale: str) -> None:
    value = float(counts * Fraction(scale))
    assert point("%ID0", scale).to_raw(value) == counts & 0xFFFFFFFF


@given(st.sampled_from(["%IX3.5", "%IB7", "%IW9", "%ID11", "%IL13"]), st.integers(0, 2**64 - 1))
def test_a_raw_value_is_read_from_the_image_as_it_was_written(address: str, number: int) -> None:
    made = point(address)
    raw = number & ((1 << (1 if made.is_bit else 8 * made.width)) - 1)
    area, offset, data, mask = made.image_write(raw)
    assert (area, offset) == made.image_place()[:2]
    assert made.from_image(data) == raw
    assert (mask is not None) == made.is_bit


# wiring


def test_a_wiring_names_ports_of_the_plant() -> None:
    with pytest.raises(CouplingError, match="did you mean 'level'") as caught:
        points({"levle": ("%IW0", ONE)}, ["level"])
    assert caught.value.name == "levle"


def test_two_ports_do_not_share_an_address() -> None:
    with pytest.raises(CouplingError, match=r"^a has %IX0\.0 already"):
        points({"a": ("%IX0.0", ONE), "b": ("%I0.0", ONE)}, ["a", "b"])


def coupled(scale: str = "1") -> tuple[Coupling, Any]:
    plant: Any = ToyPlant({"level": 1.0, "isFull": False}, ["power", "isOpen"])
    inputs = points({"level": ("%IW0", Fraction(1, 10)), "isFull": ("%IX0.0", ONE)},
                    ["level", "isFull"])
    outputs = points({"power": ("%QW0", Fraction(1, 10)), "isOpen": ("%QX0.0", ONE)},
                     ["power", "isOpen"])
    return Coupling(plant, inputs, outputs, Fraction(scale)), plant


def test_actuators_follow_only_what_changed() -> None:
    coupling, plant = coupled()
    assert coupling.take_outputs([0xFFFF, 1]) is True
    assert coupling.take_outputs([0xFFFF, 1]) is False
    assert coupling.take_outputs([5, 1]) is True
    assert plant.told == [(0, {"power": -0.1, "isOpen": True}),
                          (0, {"power": 0.5, "isOpen": True})]


def test_inputs_are_given_in_their_order() -> None:
    coupling, plant = coupled()
    plant.readings |= {"level": 6.5, "isFull": True}
    assert coupling.give_inputs() == [65, 1]


def test_plant_time_begins_where_the_plant_stood() -> None:
    plant: Any = ToyPlant({}, [])
    plant.t_ns = 1000
    coupling = Coupling(plant, [], [], Fraction(3))
    coupling.advance(10)
    assert plant.t_ns == 1030


def test_the_plant_never_goes_back() -> None:
    coupling, plant = coupled()
    coupling.advance(50)
    coupling.advance(20)
    assert plant.t_ns == 50
