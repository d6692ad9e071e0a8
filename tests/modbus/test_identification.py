"""Function code 43/14, Read Device Identification (application protocol, section 6.21)."""

from __future__ import annotations

import pytest

from plcemu.io.exchange import Exchange
from plcemu.modbus import AddressMap, Identity, Unit

BASIC, REGULAR, EXTENDED, ONE = 1, 2, 3, 4


def identify(unit: Unit, access: int, number: int = 0) -> bytes:
    return unit.handle(bytes((0x2B, 0x0E, access, number)))


def objects(response: bytes) -> dict[int, bytes]:
    """Return the objects of a response, checking that their lengths add up."""
    found, at = {}, 7
    while at < len(response):
        number, size = response[at], response[at + 1]
        found[number], at = response[at + 2:at + 2 + size], at + 2 + size
    assert at == len(response)
    assert len(found) == response[6]
    return found


def unit_of(exchange: Exchange, identity: Identity) -> Unit:
    return Unit(AddressMap(), exchange.port("test"), identity)


def test_basic_access_shows_vendor_product_code_and_revision(unit: Unit) -> None:
    response = identify(unit, BASIC)
    assert response[:7] == bytes.fromhex("2b 0e 01 82 00 00 03")
    assert objects(response) == {0: b"Example", 1: b"PLC-1", 2: b"2.0"}


def test_regular_access_shows_the_objects_that_have_a_text(unit: Unit) -> None:
    assert objects(identify(unit, REGULAR)) == {
        0: b"Example", 1: b"PLC-1", 2: b"2.0", 4: b"Emulator", 6: b"tank"}


def test_stream_access_starts_at_the_object_asked_for(unit: Unit) -> None:
    assert list(objects(identify(unit, REGULAR, 4))) == [4, 6]


@pytest.mark.parametrize("access, number", [(REGULAR, 0x03), (REGULAR, 0x77), (BASIC, 0x04)])
def test_stream_access_to_an_object_not_shown_starts_at_the_first(
        unit: Unit, access: int, number: int) -> None:
    assert identify(unit, access, number) == identify(unit, access, 0)


def test_extended_access_is_answered_with_what_there_is(unit: Unit) -> None:
    assert objects(identify(unit, EXTENDED)) == objects(identify(unit, REGULAR))


def test_private_objects_are_shown_by_extended_access_only(exchange: Exchange) -> None:
    unit = unit_of(exchange, Identity(extended={0x90: "b", 0x80: "a"}))
    response = identify(unit, EXTENDED)
    assert response[3] == 0x83
    assert list(objects(response)) == [0, 1, 2, 0x80, 0x90]
    assert list(objects(identify(unit, REGULAR))) == [0, 1, 2]


def test_a_server_with_the_mandatory_objects_only_conforms_to_the_basic_level(
        exchange: Exchange) -> None:
    assert identify(unit_of(exchange, Identity()), BASIC)[3] == 0x81


def test_individual_access_shows_one_object(unit: Unit) -> None:
    assert identify(unit, ONE, 4) == bytes.fromhex("2b 0e 04 82 00 00 01 04 08") + b"Emulator"


def test_individual_access_to_an_object_not_shown_is_an_illegal_address(unit: Unit) -> None:
    assert identify(unit, ONE, 3) == bytes.fromhex("ab 02")


@pytest.mark.parametrize("access", [0, 5, 0x81, 0xFF])
def test_an_unknown_access_code_is_an_illegal_value(unit: Unit, access: int) -> None:
    assert identify(unit, access) == bytes.fromhex("ab 03")


def test_what_does_not_fit_follows_in_the_next_response(exchange: Exchange) -> None:
    identity = Identity(vendor="v" * 100, product_code="p" * 100, revision="r" * 42, url="u" * 244)
    unit = unit_of(exchange, identity)
    first = identify(unit, REGULAR)
    assert (first[4], first[5], list(objects(first))) == (0xFF, 2, [0, 1])
    second = identify(unit, REGULAR, first[5])
    assert (second[4], second[5], list(objects(second))) == (0xFF, 3, [2])
    third = identify(unit, REGULAR, second[5])
    assert (third[4], third[5], list(objects(third)), len(third)) == (0, 0, [3], 253)


def test_objects_that_fill_a_response_exactly_fit(exchange: Exchange) -> None:
    unit = unit_of(exchange, Identity(vendor="v" * 100, product_code="p" * 100, revision="r" * 40))
    response = identify(unit, BASIC)
    assert (len(response), response[4], list(objects(response))) == (253, 0, [0, 1, 2])


def test_each_unit_has_an_identity_of_its_own(exchange: Exchange) -> None:
    units = [unit_of(exchange, Identity(vendor=name)) for name in ("first", "second")]
    assert [objects(identify(u, BASIC))[0] for u in units] == [b"first", b"second"]


@pytest.mark.parametrize("wrong, text", [
    ({"vendor": "x" * 245}, "0x00 must be at most 244 ASCII characters"),
    ({"model_name": "Größe"}, "0x05 must be at most 244 ASCII characters"),
    ({"extended": {0x7F: "x"}}, "0x7f is not private"),
    ({"extended": {0x100: "x"}}, "0x100 is not private"),
])
def test_an_identity_that_cannot_be_sent_is_refused(wrong: dict[str, object], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Identity(**wrong)  # type: ignore[arg-type]
