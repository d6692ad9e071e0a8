"""The table of operations: name, operands, results and meaning of every one of them.

An operation on values is `name.type`, with a machine type as suffix; its meaning is a Python
function on Python values, which is the reference for every engine. What touches memory, locals or
the flow of control is in `STRUCTURAL` and is carried out by the engine itself.

Integers wrap to their width. Integer division truncates towards zero. Dividing an integer by zero
is a fault; REAL and LREAL follow IEEE 754, and what is not a number is always the same bits, also
once it is loaded from memory. A
REAL becomes an integer by rounding half to even, then wrapping; one that is not finite is a fault.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

Number = int | float

INTEGERS = {"i8": (8, True), "i16": (16, True), "i32": (32, True), "i64": (64, True),
             "u8": (8, False), "u16": (16, False), "u32": (32, False), "u64": (64, False)}
FLOATS = ("f32", "f64")
MACHINE_TYPES = ("bool", *INTEGERS, *FLOATS)
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
    bits, signed = INTEGERS[machine]
    value &= (1 << bits) - 1
    return value - (1 << bits) if signed and value >> (bits - 1) else value


def round_float(value: float, machine: str) -> float:
    """Round to the nearest value of a float machine type; beyond the range to infinity."""
    if math.isnan(value):
        return math.nan
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


def _to_float(value: Number, machine: str) -> float:
    """Convert to a float, rounded once: a large integer must not be rounded to f64 before f32."""
    if machine == "f64" or isinstance(value, float) or abs(value) < 1 << 53:
        return round_float(float(value), machine)
    size = abs(value)
    sticky = size >> 11 | (size & 0x7FF != 0)
    return math.copysign(round_float(float(sticky), machine) * 2048.0, value)


def _conversion(target: str) -> Callable[[Number], Number]:
    if target == "bool":
        return lambda value: value != 0
    if target in FLOATS:
        return lambda value: _to_float(value, target)
    return lambda value: _to_integer(value, target)


def _guarded(fn: Callable[[float], float], below: float = math.nan) -> Callable[[float], float]:
    """Return a function that gives IEEE values where Python raises: NaN outside the domain."""
    def guarded(a: float) -> float:
        try:
            return fn(a)
        except ValueError:
            return below if a == 0 else math.nan
        except OverflowError:
            return math.inf
    return guarded


def _power(a: float, b: float) -> float:
    try:
        value = a ** b
    except ZeroDivisionError:
        return math.inf
    except OverflowError:
        return -math.inf if a < 0 and b % 2 == 1 else math.inf
    return math.nan if isinstance(value, complex) else value


def _shift_count(count: int) -> int:
    if count < 0:
        raise Fault("a shift by a negative number of bits")
    return count


def _rotated(value: int, count: int, bits: int) -> int:
    count %= bits
    return (value << count | value >> (bits - count)) & ((1 << bits) - 1)


def _shifts(m: str, bits: int) -> list[Op]:
    """Return the shifts of a bit string; by its width or more everything is shifted out."""
    return [
        Op(f"shl.{m}", (m, "i32"), m, lambda a, n: wrap(a << min(_shift_count(n), bits), m)),
        Op(f"shr.{m}", (m, "i32"), m, lambda a, n: a >> min(_shift_count(n), bits)),
        Op(f"rol.{m}", (m, "i32"), m, lambda a, n: _rotated(a, _shift_count(n), bits)),
        Op(f"ror.{m}", (m, "i32"), m, lambda a, n: _rotated(a, -_shift_count(n), bits)),
    ]


_FLOAT_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sqrt": _guarded(math.sqrt), "ln": _guarded(math.log, -math.inf),
    "log": _guarded(math.log10, -math.inf), "exp": _guarded(math.exp),
    "sin": _guarded(math.sin), "cos": _guarded(math.cos), "tan": _guarded(math.tan),
    "asin": _guarded(math.asin), "acos": _guarded(math.acos), "atan": math.atan,
    "abs": abs,
}


def _truncation(target: str) -> Callable[[float], int]:
    def truncate(a: float) -> int:
        if not math.isfinite(a):
            raise Fault(f"{a} has no integer value")
        return wrap(math.trunc(a), target)
    return truncate


def _build() -> dict[str, Op]:
    table: list[Op] = []
    for m in MACHINE_TYPES:
        table += [Op(f"{n}.{m}", (m, m), "bool", fn) for n, fn in _COMPARISONS.items()]
        table += [Op(f"to.{m}.{t}", (m,), t, _conversion(t)) for t in MACHINE_TYPES if t != m]
    for m, (bits, signed) in INTEGERS.items():
        table += [Op(f"{n}.{m}", (m, m), m, _wrapped(fn, m))
                  for n, fn in _INTEGER_ARITHMETIC.items()]
        table.append(Op(f"neg.{m}", (m,), m, _wrapped(lambda a: -a, m)))
        if not signed:
            table += [Op(f"{n}.{m}", (m, m), m, fn) for n, fn in _BITWISE.items()]
            table.append(Op(f"not.{m}", (m,), m, _wrapped(lambda a: ~a, m)))
            table += _shifts(m, bits)
        table.append(Op(f"abs.{m}", (m,), m, _wrapped(abs, m)))
    for m in FLOATS:
        table += [Op(f"{n}.{m}", (m, m), m, _rounded(fn, m))
                  for n, fn in _FLOAT_ARITHMETIC.items()]
        table.append(Op(f"neg.{m}", (m,), m, _rounded(lambda a: -a, m)))
        table.append(Op(f"expt.{m}", (m, m), m, _rounded(_power, m)))
        table += [Op(f"{n}.{m}", (m,), m, _rounded(fn, m)) for n, fn in _FLOAT_FUNCTIONS.items()]
        table += [Op(f"trunc.{m}.{t}", (m,), t, _truncation(t)) for t in INTEGERS]
    table += [Op(f"{n}.bool", ("bool", "bool"), "bool", fn) for n, fn in _BITWISE.items()]
    table.append(Op("not.bool", ("bool",), "bool", lambda a: a ^ 1))
    return {op.name: op for op in table}


VALUE_OPS: dict[str, Op] = _build()

def distance(value: int, low: int, count: int, size: int) -> int:
    """Return how far an element is from its array's start, in bytes: the meaning of `index`."""
    if not 0 <= value - low < count:
        raise Fault(f"index {value} is outside {low}..{low + count - 1}")
    return (value - low) * size


def overrun(budget: int) -> NoReturn:
    """Stop a run whose jumps backwards cost more than it may spend."""
    raise Fault(f"the scan does not end: jumps backwards cost over {budget} instructions")


STRUCTURAL: dict[str, str] = {
    "const": "push a constant; argument: (machine type, value)",
    "load": "push a value from memory; argument: (machine type, base, offset)",
    "store": "pop a value into memory; argument: (machine type, base, offset)",
    "addr": "push an address; argument: (base, offset)",
    "loadat": "pop an address, push the value there; argument: (machine type, offset)",
    "storeat": "pop a value and the address below it, store; argument: (machine type, offset)",
    "copy": "pop a source and the target below it, copy bytes; argument: how many",
    "index": "pop an i64 index, push its distance in bytes; argument: (lowest, count, size)",
    "select": "pop a BOOL, a value for FALSE and one for TRUE, push one; argument: machine type",
    "builtin": "run a built-in function on memory; argument: its name in ir.builtins",
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

def is_value(value: object, machine: str) -> bool:
    """Whether a Python value is one of a machine type."""
    if machine == "bool":
        return isinstance(value, bool | int) and value in (0, 1)
    if machine in FLOATS:
        return isinstance(value, float) and (math.isnan(value)
                                             or round_float(value, machine) == value)
    return isinstance(value, int) and machine in INTEGERS and wrap(value, machine) == value


BASES = ("this", "memory")
"""What an offset counts from: the instance the function runs on, or the start of the block."""
