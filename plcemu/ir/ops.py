"""The table of operations: name, operands, results and meaning of every one of them.

An operation on values is `name.type`, with a machine type as suffix; its meaning is a Python
function on Python values, which is the reference for every engine. What touches memory, locals or
the flow of control is in `STRUCTURAL` and is carried out by the engine itself.

Integers wrap to their width. Integer division truncates towards zero. Dividing an integer by zero
is a fault; REAL and LREAL follow IEEE 754.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

Number = int | float

_INTEGERS = {"i8": (8, True), "i16": (16, True), "i32": (32, True), "i64": (64, True),
             "u8": (8, False), "u16": (16, False), "u32": (32, False), "u64": (64, False)}
_FLOATS = ("f32", "f64")
MACHINE_TYPES = ("bool", *_INTEGERS, *_FLOATS)
SIZES = {"bool": 1, "i8": 1, "i16": 2, "i32": 4, "i64": 8, "u8": 1, "u16": 2, "u32": 4, "u64": 8,
         "f32": 4, "f64": 8}
STRUCT_CODES = {"bool": "B", "i8": "b", "i16": "h", "i32": "i", "i64": "q", "u8": "B", "u16": "H",
                "u32": "I", "u64": "Q", "f32": "f", "f64": "d"}


class Fault(Exception):
    """An operation has no result; the reason is shown to the user."""


@dataclass(frozen=True, slots=True)
class Op:
    """One operation on values.

    Attributes:
        name: with its type suffix, such as `add.i16`.
        pops: machine types it takes from the stack, the top last.
        pushes: the machine type of its result.
        fn: its meaning.
    """

    name: str
    pops: tuple[str, ...]
    pushes: str
    fn: Callable[..., Number]


def wrap(value: int, machine: str) -> int:
    """Reduce an integer to the width of an integer machine type (two's complement)."""
    bits, signed = _INTEGERS[machine]
    value &= (1 << bits) - 1
    return value - (1 << bits) if signed and value >> (bits - 1) else value


def round_float(value: float, machine: str) -> float:
    """Round to the nearest value of a float machine type; beyond the range to infinity."""
    if machine == "f64":
        return value
    try:
        rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)
    return rounded


def _truncating_div(a: int, b: int) -> int:
    if b == 0:
        raise Fault("division by zero")
    quotient = abs(a) // abs(b)
    return -quotient if (a < 0) != (b < 0) else quotient


def _truncating_mod(a: int, b: int) -> int:
    if b == 0:
        raise Fault("division by zero in MOD")
    return a - b * _truncating_div(a, b)


def _float_div(a: float, b: float) -> float:
    if b:
        return a / b
    if a == 0 or math.isnan(a):
        return math.nan
    return math.copysign(math.inf, a) * math.copysign(1.0, b)


_INTEGER_ARITHMETIC: dict[str, Callable[[int, int], int]] = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b,
    "div": _truncating_div, "mod": _truncating_mod,
}
_FLOAT_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b,
    "div": _float_div,
}
_BITWISE: dict[str, Callable[[int, int], int]] = {
    "and": lambda a, b: a & b, "or": lambda a, b: a | b, "xor": lambda a, b: a ^ b,
}
_COMPARISONS: dict[str, Callable[[Number, Number], bool]] = {
    "eq": lambda a, b: a == b, "ne": lambda a, b: a != b, "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b, "gt": lambda a, b: a > b, "ge": lambda a, b: a >= b,
}


def _wrapped(fn: Callable[..., int], machine: str) -> Callable[..., Number]:
    return lambda *operands: wrap(fn(*operands), machine)


def _rounded(fn: Callable[..., float], machine: str) -> Callable[..., Number]:
    return lambda *operands: round_float(fn(*operands), machine)


def _to_integer(value: Number, machine: str) -> int:
    """Convert to an integer; a REAL is rounded half to even (IEC 61131-3, 2.5.1.5.1, IEC 559)."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise Fault(f"{value} has no integer value")
        value = round(value)
    return wrap(int(value), machine)


def _conversion(source: str, target: str) -> Callable[[Number], Number]:
    if target == "bool":
        return lambda value: value != 0
    if target in _FLOATS:
        return lambda value: round_float(float(value), target)
    return lambda value: _to_integer(value, target)


def _build() -> dict[str, Op]:
    table: list[Op] = []
    for m in MACHINE_TYPES:
        table += [Op(f"{n}.{m}", (m, m), "bool", fn) for n, fn in _COMPARISONS.items()]
        table += [Op(f"to.{m}.{t}", (m,), t, _conversion(m, t)) for t in MACHINE_TYPES if t != m]
    for m, (_, signed) in _INTEGERS.items():
        table += [Op(f"{n}.{m}", (m, m), m, _wrapped(fn, m))
                  for n, fn in _INTEGER_ARITHMETIC.items()]
        table.append(Op(f"neg.{m}", (m,), m, _wrapped(lambda a: -a, m)))
        if not signed:
            table += [Op(f"{n}.{m}", (m, m), m, fn) for n, fn in _BITWISE.items()]
            table.append(Op(f"not.{m}", (m,), m, _wrapped(lambda a: ~a, m)))
    for m in _FLOATS:
        table += [Op(f"{n}.{m}", (m, m), m, _rounded(fn, m))
                  for n, fn in _FLOAT_ARITHMETIC.items()]
        table.append(Op(f"neg.{m}", (m,), m, lambda a: -a))
    table += [Op(f"{n}.bool", ("bool", "bool"), "bool", fn) for n, fn in _BITWISE.items()]
    table.append(Op("not.bool", ("bool",), "bool", lambda a: a ^ 1))
    return {op.name: op for op in table}


VALUE_OPS: dict[str, Op] = _build()

STRUCTURAL: dict[str, str] = {
    "const": "push a constant; argument: (machine type, value)",
    "load": "push a value from memory; argument: (machine type, base, offset)",
    "store": "pop a value into memory; argument: (machine type, base, offset)",
    "addr": "push an address; argument: (base, offset)",
    "get": "push a local; argument: its number",
    "set": "pop into a local; argument: its number",
    "drop": "pop a value and forget it",
    "label": "a target of jumps, where the stack is empty; argument: its number",
    "jump": "go to a label; argument: its number",
    "jumpif": "pop a BOOL, go to a label if it is TRUE; argument: its number",
    "jumpifnot": "pop a BOOL, go to a label if it is FALSE; argument: its number",
    "call": "run a function on the instance whose address is popped; argument: its name",
    "ret": "return to the caller, with the result on the stack if the function has one",
    "fault": "stop with a program fault; argument: the reason",
}
"""The operations that an engine carries out itself, with their arguments."""

BASES = ("this", "memory")
"""What an offset counts from: the instance the function runs on, or the start of the block."""
