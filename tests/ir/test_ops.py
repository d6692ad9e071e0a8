"""The table of operations against an oracle of its own: two's complement and IEEE 754."""

import math
import struct
from contextlib import suppress
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.ir.ops import MACHINE_TYPES, STRUCTURAL, VALUE_OPS, Fault, is_value

INTEGERS = {f"{sign}{bits}": (bits, sign == "i") for sign in "iu" for bits in (8, 16, 32, 64)}
CODES = dict(zip(INTEGERS, "bhiqBHIQ", strict=True))


def low(m):
    return -(1 << INTEGERS[m][0] - 1) if INTEGERS[m][1] else 0


def high(m):
    return (1 << INTEGERS[m][0] - INTEGERS[m][1]) - 1


def of(m):
    edges = st.sampled_from([low(m), low(m) + 1, 0, 1, high(m) - 1, high(m)])
    return edges | st.integers(low(m), high(m))


def pairs(machines=tuple(INTEGERS)):
    return st.sampled_from(machines).flatmap(lambda m: st.tuples(st.just(m), of(m), of(m)))


def bits(value, m):
    """Reduce to the width as a C cast does, by way of bytes."""
    raw = (value % (1 << 64)).to_bytes(8, "little")[:INTEGERS[m][0] // 8]
    return struct.unpack("<" + CODES[m], raw)[0]


def call(name, *operands):
    return VALUE_OPS[name].fn(*operands)


def f32(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


@given(pairs())
def test_integer_arithmetic_wraps(case):
    m, a, b = case
    assert call(f"add.{m}", a, b) == bits(a + b, m)
    assert call(f"sub.{m}", a, b) == bits(a - b, m)
    assert call(f"mul.{m}", a, b) == bits(a * b, m)
    assert call(f"neg.{m}", a) == bits(-a, m)


@given(pairs().filter(lambda case: case[2] != 0))
def test_integer_division_truncates_and_wraps(case):
    m, a, b = case
    exact = math.trunc(Fraction(a, b))
    assert call(f"div.{m}", a, b) == bits(exact, m)
    assert call(f"mod.{m}", a, b) == bits(a - b * exact, m)


@pytest.mark.parametrize("m", INTEGERS)
def test_integer_division_by_zero_is_a_fault(m):
    for op in ("div", "mod"):
        with pytest.raises(Fault, match="division by zero"):
            call(f"{op}.{m}", 1, 0)


def test_the_smallest_integer_divided_by_minus_one_wraps_to_itself():
    assert [call(f"div.{m}", low(m), -1) for m in ("i8", "i16", "i32", "i64")] == [
        -128, -32768, -2**31, -2**63]


@given(pairs(("u8", "u16", "u32", "u64")))
def test_bitwise_operations(case):
    m, a, b = case
    assert (call(f"and.{m}", a, b), call(f"or.{m}", a, b), call(f"xor.{m}", a, b)) == (
        a & b, a | b, a ^ b)
    assert call(f"not.{m}", a) == high(m) - a


@given(pairs())
def test_comparisons_of_integers(case):
    m, a, b = case
    found = [call(f"{op}.{m}", a, b) for op in ("eq", "ne", "lt", "le", "gt", "ge")]
    assert found == [a == b, a != b, a < b, a <= b, a > b, a >= b]


singles = st.floats(width=32)


@given(singles, singles)
def test_real_arithmetic_is_that_of_ieee_754_single_precision(a, b):
    assert same(call("add.f32", a, b), rounded(lambda: a + b))
    assert same(call("sub.f32", a, b), rounded(lambda: a - b))
    assert same(call("mul.f32", a, b), rounded(lambda: a * b))


def rounded(compute):
    value = compute()
    try:
        return f32(value)
    except OverflowError:
        return math.copysign(math.inf, value)


def same(a, b):
    return struct.pack("<d", a) == struct.pack("<d", b) or (math.isnan(a) and math.isnan(b))


@given(singles.filter(bool), singles.filter(bool))
def test_real_division_by_what_is_not_zero(a, b):
    assert same(call("div.f32", a, b), rounded(lambda: a / b))


@pytest.mark.parametrize(("a", "b", "expected"), [
    (1.0, 0.0, math.inf), (-1.0, 0.0, -math.inf), (1.0, -0.0, -math.inf), (0.0, 0.0, math.nan),
    (math.inf, 0.0, math.inf), (math.nan, 0.0, math.nan), (math.inf, math.inf, math.nan),
    (1e38, 1e-38, math.inf)])
def test_real_division_at_its_edges(a, b, expected):
    assert same(call("div.f32", f32(a), f32(b)), expected)


def test_what_is_not_a_number_is_always_the_same_bits():
    makers = [call("sub.f64", math.inf, math.inf), call("div.f32", 0.0, 0.0),
              call("neg.f64", math.nan), call("add.f32", -math.nan, 1.0),
              call("to.f64.f32", -math.nan), call("mul.f64", 0.0, math.inf)]
    assert {struct.pack("<d", value) for value in makers} == {struct.pack("<d", math.nan)}


def test_comparisons_with_what_is_not_a_number_are_false_but_for_ne():
    found = [call(f"{op}.f64", math.nan, math.nan) for op in ("eq", "ne", "lt", "le", "gt", "ge")]
    assert found == [False, True, False, False, False, False]


@given(st.sampled_from(sorted(INTEGERS)).flatmap(lambda m: st.tuples(st.just(m), of(m))),
       st.sampled_from(sorted(INTEGERS)))
def test_integers_convert_by_their_bits(case, target):
    source, value = case
    expected = value if target == source else call(f"to.{source}.{target}", value)
    assert expected == bits(value, target)


@given(st.integers(0, 2**64 - 1))
def test_large_integers_round_to_real_once(value):
    found = Fraction(call("to.u64.f32", value))
    neighbours = [Fraction(f) for f in around(float(found))]
    distance = abs(found - value)
    assert all(distance < abs(n - value) or (distance == abs(n - value) and is_even(float(found)))
               for n in neighbours)


def around(value):
    raw = struct.unpack("<I", struct.pack("<f", value))[0]
    return [struct.unpack("<f", struct.pack("<I", raw + d))[0] for d in (-1, 1) if raw + d >= 0]


def is_even(value):
    return struct.unpack("<I", struct.pack("<f", value))[0] % 2 == 0


@pytest.mark.parametrize(("value", "expected"), [
    (0.5, 0), (1.5, 2), (2.5, 2), (-0.5, 0), (-1.5, -2), (2.4999, 2), (32767.4, 32767),
    (32768.0, -32768), (65536.0, 0)])
def test_reals_round_half_to_even_then_wrap(value, expected):
    assert call("to.f64.i16", value) == expected


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_what_is_not_finite_has_no_integer(value):
    with pytest.raises(Fault, match="has no integer value"):
        call("to.f32.i32", value)


def test_conversions_to_and_from_bool():
    assert [call(f"to.{m}.bool", 0) for m in ("i8", "u64")] == [False, False]
    assert (call("to.f32.bool", math.nan), call("to.f32.bool", -0.0)) == (True, False)
    assert (call("to.bool.f64", True), call("to.bool.i8", True)) == (1.0, 1)


@given(st.sampled_from(sorted(VALUE_OPS)), st.data())
def test_every_result_is_a_value_of_the_type_it_pushes(name, data):
    op = VALUE_OPS[name]
    sources = {"bool": st.booleans(), "f32": singles, "f64": st.floats()}
    operands = [data.draw(sources[m] if m in sources else of(m)) for m in op.pops]
    with suppress(Fault):
        assert is_value(op.fn(*operands), op.pushes)


def test_the_table_has_every_operation_of_every_type():
    assert set(MACHINE_TYPES) == {"bool", "f32", "f64", *INTEGERS}
    assert not set(VALUE_OPS) & set(STRUCTURAL)
    assert all(f"to.{a}.{b}" in VALUE_OPS for a in MACHINE_TYPES for b in MACHINE_TYPES if a != b)
