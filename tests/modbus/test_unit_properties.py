"""What holds for every request: any bytes get a valid response, reads see what was written."""

from __future__ import annotations

import struct
from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.io.exchange import Exchange
from plcemu.modbus import AddressMap, Identity, Unit
from plcemu.modbus.pdu import FUNCTION_CODES, PDU_BYTES

Cell = tuple[str, int]

BITS = {1: [(0, 8192, "QX"), (16384, 8192, "IX"), (24576, 8192, "MX")], 2: [(0, 8192, "IX")]}
REGISTERS = {3: [(0, 1024, "QW"), (1024, 1024, "MW"), (2048, 2048, "MD"), (4096, 4096, "ML"),
                 (16384, 1024, "IW")], 4: [(0, 1024, "IW")]}
"""The default map once more: by reading function code the first number, the count and the area."""


def fresh_unit() -> tuple[Exchange, Unit]:
    exchange = Exchange(bytearray())
    return exchange, Unit(AddressMap(), exchange.port("test"), Identity(url="http://example.org"))


def cells(table: list[tuple[int, int, str]], first: int, count: int) -> list[Cell]:
    """Return the cells of a run's mapped numbers; fewer than `count` if some are not mapped."""
    return [(area, number - start) for number in range(first, first + count)
            for start, size, area in table if start <= number < start + size]


class Model:
    """The process image as a dictionary of bits and registers, one by one."""

    def __init__(self) -> None:
        self.values: dict[Cell, int] = {}

    def read(self, run: list[Cell]) -> list[int]:
        return [self.values.get(cell, 0) for cell in run]

    def write(self, run: list[Cell], values: list[int]) -> None:
        self.values.update(zip(run, values, strict=True))


def packed(bits: list[int]) -> bytes:
    padded = bits + [0] * (-len(bits) % 8)
    return bytes(sum(bit << i for i, bit in enumerate(padded[at:at + 8]))
                 for at in range(0, len(padded), 8))


def registers(values: list[int]) -> bytes:
    return struct.pack(f">{len(values)}H", *values)


def counted(data: bytes) -> bytes:
    return bytes((len(data),)) + data


Step = Callable[[Model], tuple[bytes, bytes]]
"""Applies itself to the model and returns a request and the response that the model expects."""


def refused(code: int) -> bytes:
    return bytes((0x80 | code, 2))


def read_step(code: int, first: int, count: int) -> Step:
    def step(model: Model) -> tuple[bytes, bytes]:
        run = cells((BITS | REGISTERS)[code], first, count)
        data = {True: packed, False: registers}[code in BITS](model.read(run))
        expected = bytes((code,)) + counted(data) if len(run) == count else refused(code)
        return struct.pack(">BHH", code, first, count), expected
    return step


def write_step(code: int, reader: int, first: int, values: list[int], encoded: bytes) -> Step:
    def step(model: Model) -> tuple[bytes, bytes]:
        run = cells((BITS | REGISTERS)[reader], first, len(values))
        is_mapped = len(run) == len(values)
        model.write(run if is_mapped else [], values if is_mapped else [])
        head = struct.pack(">BHH", code, first, len(values))
        return head + counted(encoded), head if is_mapped else refused(code)
    return step


def mask_step(number: int, and_mask: int, or_mask: int) -> Step:
    def step(model: Model) -> tuple[bytes, bytes]:
        run = cells(REGISTERS[3], number, 1)
        new = [(v & and_mask) | (or_mask & ~and_mask & 0xFFFF) for v in model.read(run)]
        model.write(run, new)
        request = struct.pack(">BHHH", 22, number, and_mask, or_mask)
        return request, request if run else refused(22)
    return step


bit_numbers = st.one_of(st.integers(0, 40), st.integers(8180, 8200), st.integers(16380, 16420),
                        st.integers(24560, 24600), st.integers(32755, 32770))
register_numbers = st.one_of(st.integers(0, 12), st.integers(1018, 1030), st.integers(2040, 2056),
                             st.integers(4090, 4100), st.integers(8185, 8195),
                             st.integers(16380, 16396), st.integers(17400, 17410))
words = st.integers(0, 65535)

steps = st.one_of(
    st.builds(read_step, st.sampled_from([1, 2]), bit_numbers, st.integers(1, 70)),
    st.builds(read_step, st.sampled_from([3, 4]), register_numbers, st.integers(1, 12)),
    st.builds(lambda first, bits: write_step(15, 1, first, bits, packed(bits)),
              bit_numbers, st.lists(st.integers(0, 1), min_size=1, max_size=70)),
    st.builds(lambda first, values: write_step(16, 3, first, values, registers(values)),
              register_numbers, st.lists(words, min_size=1, max_size=12)),
    st.builds(mask_step, register_numbers, words, words),
)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(steps, st.booleans()), max_size=25))
def test_every_read_sees_all_earlier_writes_whether_or_not_a_scan_came_between(
        sequence: list[tuple[Step, bool]]) -> None:
    exchange, unit = fresh_unit()
    scans = {True: exchange.update_inputs, False: lambda: None}
    model = Model()
    for step, is_scan_next in sequence:
        request, expected = step(model)
        assert unit.handle(request) == expected
        scans[is_scan_next]()


@settings(deadline=None)
@given(bit_numbers, st.lists(st.integers(0, 1), min_size=1, max_size=70))
def test_a_run_of_bits_leaves_its_neighbours_alone(first: int, bits: list[int]) -> None:
    exchange, unit = fresh_unit()
    for area in ("QX", "IX", "MX"):
        exchange.port("before").write(area, 0, b"\xa5" * 1024)
    exchange.update_inputs()
    model = Model()
    for area in ("QX", "IX", "MX"):
        model.write([(area, i) for i in range(8192)], [0xA5 >> i % 8 & 1 for i in range(8192)])
    request, expected = write_step(15, 1, first, bits, packed(bits))(model)
    assert unit.handle(request) == expected
    exchange.update_inputs()
    for area in ("QX", "IX", "MX"):
        whole = packed(model.read([(area, i) for i in range(8192)]))
        assert exchange.published(area, 0, 1024) == whole


def is_valid(request: bytes, response: bytes) -> bool:
    """Whether a response has a form that the application protocol allows for the request."""
    code = request[0] if request else 0
    is_exception = response[0] == 0x80 | code and len(response) == 2 and response[1] in (1, 2, 3)
    is_normal = response[0] == code and code in FUNCTION_CODES and 1 < len(response) <= PDU_BYTES
    return is_exception or is_normal


likely_requests = st.builds(
    lambda code, head, tail: bytes((code,)) + head + tail,
    st.sampled_from(sorted(FUNCTION_CODES)),
    st.one_of(st.binary(max_size=9), st.builds(lambda a, b: struct.pack(">HHB", a, b, 2 * b & 0xFF),
                                               words, st.integers(0, 130))),
    st.binary(max_size=250))


@settings(deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=260), likely_requests), max_size=20))
def test_any_bytes_get_a_valid_response(requests: list[bytes]) -> None:
    _, unit = fresh_unit()
    for request in requests:
        assert is_valid(request, unit.handle(request))


@settings(deadline=None)
@given(st.integers(0, 9), st.integers(0, 9), st.lists(words, min_size=1, max_size=9))
def test_a_read_write_request_is_the_write_and_then_the_read(read: int, write: int,
                                                             values: list[int]) -> None:
    _, at_once = fresh_unit()
    _, apart = fresh_unit()
    data = registers(values)
    request = struct.pack(">BHHHHB", 23, read, 9, write, len(values), len(data)) + data
    apart.handle(struct.pack(">BHHB", 16, write, len(values), len(data)) + data)
    assert at_once.handle(request)[1:] == apart.handle(struct.pack(">BHH", 3, read, 9))[1:]
