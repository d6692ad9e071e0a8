"""The address map: the promised default, its checks, and finding an address from outside."""

from __future__ import annotations

from typing import Any

import pytest

from plcemu.base.areas import parse_address
from plcemu.io.exchange import Exchange
from plcemu.modbus import (
    DEFAULT_RANGES,
    AddressMap,
    MapRange,
    ModbusException,
    ObjectType,
    UnmappedError,
)

COIL, DISCRETE = ObjectType.COIL, ObjectType.DISCRETE
INPUT, HOLDING = ObjectType.INPUT, ObjectType.HOLDING


def test_the_default_map_is_the_promised_one() -> None:
    promised = [
        ("discrete", 0, 8191, "IX", "r", False),
        ("coil", 0, 8191, "QX", "rw", False),
        ("input", 0, 1023, "IW", "r", False),
        ("holding", 0, 1023, "QW", "rw", False),
        ("holding", 1024, 2047, "MW", "rw", False),
        ("holding", 2048, 4095, "MD", "rw", False),
        ("holding", 4096, 8191, "ML", "rw", False),
        ("coil", 16384, 24575, "IX", "rw", True),
        ("coil", 24576, 32767, "MX", "rw", False),
        ("holding", 16384, 17407, "IW", "rw", True),
    ]
    assert [(str(r.object_type), r.first, r.end - 1, r.area, r.access, r.is_field_window)
            for r in AddressMap().ranges] == promised


@pytest.mark.parametrize("address, place", [
    ("%IX0.3", (COIL, 16387, 1)),
    ("%IX1023.7", (COIL, 24575, 1)),
    ("%QX0.1", (COIL, 1, 1)),
    ("%MX2.0", (COIL, 24592, 1)),
    ("%IW2", (HOLDING, 16386, 1)),
    ("%QW1", (HOLDING, 1, 1)),
    ("%MW0", (HOLDING, 1024, 1)),
    ("%MD3", (HOLDING, 2054, 2)),
    ("%ML1023", (HOLDING, 8188, 4)),
])
def test_an_address_is_found_where_a_client_can_write_it(address: str,
                                                         place: tuple[Any, ...]) -> None:
    assert AddressMap().locate(parse_address(address)) == place
    assert AddressMap().locate(parse_address(address), writing=True) == place


def test_with_the_field_window_closed_inputs_are_found_where_they_are_read() -> None:
    closed = AddressMap(field_window=False)
    assert closed.locate(parse_address("%IX0.3")) == (DISCRETE, 3, 1)
    assert closed.locate(parse_address("%IW2")) == (INPUT, 2, 1)


def test_with_the_field_window_closed_no_input_is_found_for_writing() -> None:
    with pytest.raises(UnmappedError, match=r"%IX0.3 for writing .*field window is closed"):
        AddressMap(field_window=False).locate(parse_address("%IX0.3"), writing=True)


@pytest.mark.parametrize("address", ["%QB0", "%ID1", "%QL2"])
def test_an_address_that_no_range_shows_is_not_found(address: str) -> None:
    with pytest.raises(UnmappedError, match=f"does not show {address} to a client; add a range"):
        AddressMap().locate(parse_address(address))


def test_a_range_may_start_anywhere_in_an_area() -> None:
    own = AddressMap([MapRange(HOLDING, 100, 4, "MD", element=10, access="rw")])
    assert own.locate(parse_address("%MD11")) == (HOLDING, 102, 2)
    with pytest.raises(UnmappedError):
        own.locate(parse_address("%MD9"))
    with pytest.raises(UnmappedError):
        own.locate(parse_address("%MD12"))


@pytest.mark.parametrize("kind, first", [(COIL, 16384), (COIL, 24575), (HOLDING, 17407)])
def test_a_closed_field_window_does_not_exist(kind: ObjectType, first: int) -> None:
    assert AddressMap().runs(kind, first, 1)
    with pytest.raises(ModbusException):
        AddressMap(field_window=False).runs(kind, first, 1)


def test_closing_the_field_window_leaves_the_other_ranges() -> None:
    closed = AddressMap(field_window=False)
    assert not closed.field_window
    assert closed.ranges == tuple(r for r in DEFAULT_RANGES if not r.is_field_window)


@pytest.mark.parametrize("wrong, text", [
    (("coil", 0, 8, "XX"), "there is no area XX"),
    (("coil", 0, 8, "QW"), "coil ranges show areas X"),
    (("holding", 0, 8, "QX"), "holding ranges show areas W, D, L"),
    (("holding", 0, 8, "QB"), "holding ranges show areas W, D, L"),
    (("coil", -1, 8, "QX"), "numbers go from 0 to 65535"),
    (("coil", 0, 0, "QX"), "a range has at least one"),
    (("coil", 65535, 2, "QX"), "numbers go from 0 to 65535"),
    (("holding", 0, 3, "MD"), "an element of MD takes 2 registers"),
    (("holding", 0, 6, "ML"), "an element of ML takes 4 registers"),
    (("holding", 0, 1025, "QW"), "leaves area QW, which ends with %QW1023"),
    (("holding", 0, 2, "QW", 1023), "leaves area QW"),
    (("coil", 0, 8193, "QX"), "leaves area QX, which ends with %QX1023.7"),
    (("coil", 0, 1, "QX", -1), "leaves area QX"),
    (("holding", 0, 1, "QW", 0, "w"), "access is r or rw, not 'w'"),
    (("discrete", 0, 1, "IX", 0, "rw"), "only coils and holding registers can be written"),
    (("input", 0, 1, "IW", 0, "rw"), "only coils and holding registers can be written"),
    (("relay", 0, 1, "IX"), "'relay'"),
])
def test_a_range_that_cannot_be_is_refused(wrong: tuple[Any, ...], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        MapRange(*wrong)


def test_ranges_of_one_object_type_must_not_overlap() -> None:
    with pytest.raises(ValueError, match=r"coil 7-14 \(MX\) overlaps coil 0-7 \(QX\)"):
        AddressMap([MapRange(COIL, 7, 8, "MX"), MapRange(COIL, 0, 8, "QX")])


def test_ranges_of_two_object_types_may_have_the_same_numbers() -> None:
    assert len(AddressMap([MapRange(COIL, 0, 8, "QX"), MapRange(DISCRETE, 0, 8, "IX")]).ranges) == 2


def test_bits_of_ranges_side_by_side_are_read_and_written_as_one_run(exchange: Exchange) -> None:
    own = AddressMap([MapRange(COIL, 10, 5, "QX", element=3, access="rw"),
                      MapRange(COIL, 15, 1, "MX", element=9, access="rw"),
                      MapRange(COIL, 16, 9, "IX", element=0, access="rw")])
    port = exchange.port("test")
    own.write_bits(port, 11, 14, bytes.fromhex("ffff"))
    assert port.read("QX", 0, 2) == bytes.fromhex("f000")
    assert port.read("MX", 0, 2) == bytes.fromhex("0002")
    assert port.read("IX", 0, 2) == bytes.fromhex("ff01")
    assert own.read_bits(port, COIL, 10, 15) == bytes.fromhex("fe7f")


def test_registers_of_ranges_side_by_side_are_read_and_written_as_one_run(
        exchange: Exchange) -> None:
    port = exchange.port("test")
    AddressMap().write_registers(port, 1023, bytes.fromhex("0102 0304"))
    assert port.read("QW", 2046, 2) + port.read("MW", 0, 2) == bytes.fromhex("0102 0304")
    assert AddressMap().read_registers(port, HOLDING, 1023, 2) == bytes.fromhex("0102 0304")


def test_a_run_that_is_partly_unmapped_writes_nothing(exchange: Exchange) -> None:
    port = exchange.port("test")
    with pytest.raises(ModbusException):
        AddressMap().write_bits(port, 8190, 3, b"\x07")
    assert exchange.waiting == 0


def test_a_double_word_shows_its_high_word_first(exchange: Exchange) -> None:
    port = exchange.port("test")
    AddressMap().write_registers(port, 2048, bytes.fromhex("1122 3344"))
    assert port.read("MD", 0, 4) == (0x11223344).to_bytes(4, "big")
