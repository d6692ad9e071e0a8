"""Every function code at its limits (application protocol V1.1b3, section 6), as tables of PDUs."""

from __future__ import annotations

import struct

import pytest

from plcemu.base.errors import LimitError
from plcemu.io.exchange import PENDING_LIMIT, Exchange, Port
from plcemu.modbus import AddressMap, Identity, MapRange, ObjectType, Unit
from plcemu.modbus.pdu import FUNCTION_CODES


def words(code: int, *values: int) -> bytes:
    return bytes((code,)) + b"".join(struct.pack(">H", v) for v in values)


def write_coils(first: int, count: int, size: int, sent: int) -> bytes:
    return words(15, first, count) + bytes((size,)) + bytes(sent)


def write_registers(first: int, count: int, size: int, sent: int) -> bytes:
    return words(16, first, count) + bytes((size,)) + bytes(sent)


def read_write(read: tuple[int, int], write: tuple[int, int], size: int, sent: int) -> bytes:
    return words(23, *read, *write) + bytes((size,)) + bytes(sent)


READS = {
    "one coil": (words(1, 0, 1), "01 01 00"),
    "nine coils take two bytes": (words(1, 0, 9), "01 02 0000"),
    "2000 coils": (words(1, 0, 2000), "01 fa" + "00" * 250),
    "the last coil of the outputs": (words(1, 8191, 1), "01 01 00"),
    "the last coil of the map": (words(1, 32767, 1), "01 01 00"),
    "coils of two ranges": (words(1, 24575, 2), "01 01 00"),
    "2000 discrete inputs": (words(2, 6192, 2000), "02 fa" + "00" * 250),
    "125 holding registers": (words(3, 0, 125), "03 fa" + "00" * 250),
    "holding registers of two ranges": (words(3, 1023, 2), "03 04" + "00" * 4),
    "holding registers of the three last markers": (words(3, 8189, 3), "03 06" + "00" * 6),
    "125 input registers": (words(4, 899, 125), "04 fa" + "00" * 250),
}

WRITES = {
    "a coil on": (words(5, 3, 0xFF00), "05 0003 ff00"),
    "a coil off": (words(5, 3, 0x0000), "05 0003 0000"),
    "a register": (words(6, 7, 0x1234), "06 0007 1234"),
    "one coil of many": (write_coils(0, 1, 1, 1), "0f 0000 0001"),
    "1968 coils": (write_coils(0, 1968, 246, 246), "0f 0000 07b0"),
    "123 registers": (write_registers(0, 123, 246, 246), "10 0000 007b"),
    "a register by masks": (words(22, 4, 0xF2, 0x25), "16 0004 00f2 0025"),
    "125 read, 121 written": (read_write((0, 125), (200, 121), 242, 242), "17 fa" + "00" * 250),
}

REFUSED = {
    "no bytes at all": (b"", "80 01"),
    "function code 0": (bytes(5), "80 01"),
    "function code 127": (bytes((127, 0)), "ff 01"),
    "a response's function code": (bytes((0x83, 2)), "83 01"),
    "an unserved function code": (words(24, 0), "98 01"),
    "MEI type 13": (bytes.fromhex("2b 0d 00"), "ab 01"),

    "0 coils": (words(1, 0, 0), "81 03"),
    "2001 coils": (words(1, 0, 2001), "81 03"),
    "65535 coils": (words(1, 0, 65535), "81 03"),
    "0 discrete inputs": (words(2, 0, 0), "82 03"),
    "2001 discrete inputs": (words(2, 0, 2001), "82 03"),
    "0 holding registers": (words(3, 0, 0), "83 03"),
    "126 holding registers": (words(3, 0, 126), "83 03"),
    "0 input registers": (words(4, 0, 0), "84 03"),
    "126 input registers": (words(4, 0, 126), "84 03"),
    "a coil neither on nor off": (words(5, 0, 0x1234), "85 03"),
    "a coil of value 1": (words(5, 0, 1), "85 03"),
    "0 coils to write": (write_coils(0, 0, 0, 0), "8f 03"),
    "1969 coils to write": (write_coils(0, 1969, 247, 247), "8f 03"),
    "a byte count too small for the coils": (write_coils(0, 9, 1, 1), "8f 03"),
    "a byte count too large for the coils": (write_coils(0, 8, 2, 2), "8f 03"),
    "0 registers to write": (write_registers(0, 0, 0, 0), "90 03"),
    "124 registers to write": (write_registers(0, 124, 248, 248), "90 03"),
    "an odd byte count": (write_registers(0, 1, 3, 3), "90 03"),
    "0 registers to read while writing": (read_write((0, 0), (0, 1), 2, 2), "97 03"),
    "126 registers to read while writing": (read_write((0, 126), (0, 1), 2, 2), "97 03"),
    "0 registers to write while reading": (read_write((0, 1), (0, 0), 0, 0), "97 03"),
    "122 registers to write while reading": (read_write((0, 1), (0, 122), 244, 244), "97 03"),
    "a wrong byte count while reading": (read_write((0, 1), (0, 2), 2, 2), "97 03"),

    "a coil after the last one": (words(1, 32768, 1), "81 02"),
    "coils that run into a gap": (words(1, 8191, 2), "81 02"),
    "coils that start in a gap": (words(1, 16383, 2), "81 02"),
    "coils beyond 65535": (words(1, 65535, 2), "81 02"),
    "discrete inputs beyond the map": (words(2, 8191, 2), "82 02"),
    "holding registers that run into a gap": (words(3, 8191, 2), "83 02"),
    "holding registers after the field window": (words(3, 17408, 1), "83 02"),
    "input registers beyond the map": (words(4, 1023, 2), "84 02"),
    "a coil in a gap": (words(5, 8192, 0xFF00), "85 02"),
    "a register in a gap": (words(6, 8192, 1), "86 02"),
    "coils to write into a gap": (write_coils(8190, 3, 1, 1), "8f 02"),
    "registers to write into a gap": (write_registers(8191, 2, 4, 4), "90 02"),
    "a register in a gap by masks": (words(22, 8192, 0, 0), "96 02"),
    "registers to read from a gap while writing": (read_write((8192, 1), (0, 1), 2, 2), "97 02"),
    "registers to write into a gap while reading": (read_write((0, 1), (8192, 1), 2, 2), "97 02"),

    "wrong quantity and wrong address": (words(3, 8192, 126), "83 03"),
    "wrong value and wrong address": (words(5, 8192, 5), "85 03"),
}

WELL_FORMED = {request[0]: request for request, _ in (READS | WRITES).values()} | {
    43: bytes.fromhex("2b 0e 01 00")}


@pytest.mark.parametrize("request_pdu, response", (READS | WRITES).values(), ids=READS | WRITES)
def test_a_request_within_the_limits_is_answered(unit: Unit, request_pdu: bytes,
                                                 response: str) -> None:
    assert unit.handle(request_pdu) == bytes.fromhex(response)
    assert unit.counters == {"requests": 1, "exceptions": 0}


@pytest.mark.parametrize("request_pdu, response", REFUSED.values(), ids=REFUSED)
def test_a_request_beyond_a_limit_is_refused_and_writes_nothing(
        unit: Unit, exchange: Exchange, request_pdu: bytes, response: str) -> None:
    assert unit.handle(request_pdu) == bytes.fromhex(response)
    assert unit.counters == {"requests": 1, "exceptions": 1}
    assert exchange.waiting == 0


def test_every_function_code_of_the_table_is_tested() -> None:
    assert set(WELL_FORMED) == set(FUNCTION_CODES)


@pytest.mark.parametrize("code", FUNCTION_CODES)
def test_a_request_with_a_byte_left_over_has_an_illegal_value(unit: Unit, code: int) -> None:
    assert unit.handle(WELL_FORMED[code] + b"\0") == bytes((0x80 | code, 3))


@pytest.mark.parametrize("code", FUNCTION_CODES)
def test_a_request_cut_short_has_an_illegal_value(unit: Unit, code: int) -> None:
    whole = WELL_FORMED[code]
    refusals = {unit.handle(whole[:end]) for end in range(1, len(whole))}
    assert refusals == {bytes((0x80 | code, 3))}


@pytest.mark.parametrize("code", sorted(set(range(1, 128)) - set(FUNCTION_CODES)))
def test_an_unknown_function_code_is_refused_as_such(unit: Unit, code: int) -> None:
    assert unit.handle(bytes((code, 0, 0, 0, 1))) == bytes((0x80 | code, 1))


def test_a_mask_write_sets_the_bits_that_the_standards_example_sets(unit: Unit) -> None:
    unit.handle(words(6, 4, 0x12))
    unit.handle(words(22, 4, 0xF2, 0x25))
    assert unit.handle(words(3, 4, 1)) == bytes.fromhex("03 02 0017")


def test_a_mask_write_leaves_to_the_program_the_bits_it_does_not_name(
        unit: Unit, exchange: Exchange) -> None:
    unit.handle(words(22, 4, 0xFF00, 0x0034))
    program = exchange.port("another writer before the same scan")
    program.write("QW", 8, bytes.fromhex("1200"))
    unit.handle(words(22, 4, 0xFF00, 0x0056))
    exchange.update_inputs()
    assert exchange.published("QW", 8, 2) == bytes.fromhex("1256")


def test_a_read_write_request_reads_what_it_wrote(unit: Unit) -> None:
    request = words(23, 9, 3, 10, 1) + bytes.fromhex("02 cafe")
    assert unit.handle(request) == bytes.fromhex("17 06 0000 cafe 0000")


def test_a_range_without_write_access_can_be_read_but_not_written(exchange: Exchange) -> None:
    shown_only = AddressMap([MapRange(ObjectType.HOLDING, 0, 10, "MW", access="r")])
    unit = Unit(shown_only, exchange.port("test"), Identity())
    assert unit.handle(words(3, 0, 1)) == bytes.fromhex("03 02 0000")
    assert unit.handle(words(6, 0, 1)) == bytes.fromhex("86 02")


def test_a_full_queue_is_answered_busy_until_the_next_scan(
        unit: Unit, exchange: Exchange, caplog: pytest.LogCaptureFixture) -> None:
    other = exchange.port("other")
    for _ in range(PENDING_LIMIT):
        other.write("QW", 0, b"\0\0")
    assert unit.handle(words(6, 0, 1)) == bytes.fromhex("86 06")
    exchange.update_inputs()
    assert unit.handle(words(6, 0, 1)) == words(6, 0, 1)
    assert [r.message.split(":")[0] for r in caplog.records] == ["test answered busy"]


def test_a_defect_of_ours_is_answered_device_failure_with_one_line_in_the_log(
        unit: Unit, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    def broken(*_: object) -> bytes:
        raise ZeroDivisionError("no image")
    monkeypatch.setattr(Port, "read", broken)
    assert unit.handle(words(3, 0, 1)) == bytes.fromhex("83 04")
    assert unit.handle(words(3, 0, 1)) == bytes.fromhex("83 04")
    assert [(r.levelname, r.message, r.exc_info) for r in caplog.records] == [
        ("ERROR", "function code 3 of test failed: ZeroDivisionError: no image", None)]


def test_limit_errors_are_the_only_reason_to_answer_busy(
        unit: Unit, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise LimitError("full")
    monkeypatch.setattr(Port, "write", full)
    refusals = {unit.handle(WELL_FORMED[code])[-1] for code in (5, 6, 15, 16, 22, 23)}
    assert refusals == {6}
