"""The table of elementary types: ranges and bytes of every row."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.base.types import ELEMENTARY

INTEGERS = {"SINT": (-2**7, 2**7 - 1), "INT": (-2**15, 2**15 - 1), "DINT": (-2**31, 2**31 - 1),
            "LINT": (-2**63, 2**63 - 1), "USINT": (0, 2**8 - 1), "UINT": (0, 2**16 - 1),
            "UDINT": (0, 2**32 - 1), "ULINT": (0, 2**64 - 1), "BYTE": (0, 2**8 - 1),
            "WORD": (0, 2**16 - 1), "DWORD": (0, 2**32 - 1), "LWORD": (0, 2**64 - 1),
            "TIME": (-2**63, 2**63 - 1), "LTIME": (-2**63, 2**63 - 1)}
SIZES = {"BOOL": 1, "SINT": 1, "INT": 2, "DINT": 4, "LINT": 8, "REAL": 4, "LREAL": 8, "TIME": 8}


@pytest.mark.parametrize("name", INTEGERS)
def test_every_integer_type_has_the_range_of_the_standard(name):
    row, (low, high) = ELEMENTARY[name], INTEGERS[name]
    assert (row.low, row.high) == (low, high)
    assert [row.unpack(row.pack(v)) for v in (low, 0, high)] == [low, 0, high]


@pytest.mark.parametrize("name", INTEGERS)
def test_a_value_beyond_the_range_is_refused(name):
    row = ELEMENTARY[name]
    for value in (row.low - 1, row.high + 1):
        with pytest.raises(ValueError, match=f"outside the range of {name}"):
            row.pack(value)


@given(st.sampled_from(sorted(INTEGERS)).flatmap(
    lambda n: st.tuples(st.just(n), st.integers(*INTEGERS[n]))))
def test_integers_are_little_endian(case):
    name, value = case
    row = ELEMENTARY[name]
    assert row.pack(value) == (value % (1 << 8 * row.size)).to_bytes(row.size, "little")


@pytest.mark.parametrize(("name", "size"), SIZES.items())
def test_sizes(name, size):
    assert ELEMENTARY[name].size == size == len(ELEMENTARY[name].pack(0))


@pytest.mark.parametrize(("name", "value"), [
    ("BOOL", 2), ("BOOL", -1), ("BOOL", 1.0), ("INT", 1.5), ("INT", "5"), ("REAL", "5"),
    ("REAL", 1e39),
    ("REAL", 10**400), ("LREAL", 10**400), ("TIME", 0.5)])
def test_a_value_of_another_kind_is_refused(name, value):
    with pytest.raises(ValueError, match=r"is not a value of|outside the range"):
        ELEMENTARY[name].pack(value)


@given(st.floats(width=32))
def test_reals_keep_their_single_precision_value(value):
    row = ELEMENTARY["REAL"]
    assert struct.pack("<d", row.unpack(row.pack(value))) == struct.pack("<d",
                                                                         value) or math.isnan(value)


def test_a_bool_is_read_as_bool():
    row = ELEMENTARY["BOOL"]
    assert [row.unpack(row.pack(v)) for v in (True, False, 1, 0)] == [True, False, True, False]
    assert isinstance(row.unpack(b"\1"), bool)


def test_a_value_is_read_at_an_offset():
    assert ELEMENTARY["INT"].unpack(memoryview(b"\0\0\xfe\xff"), 2) == -2
