"""How an operation of the machine is said in Promela.

Promela computes with the integers of C, 32 bits wide. A value of 32 bits or less is held as such an
integer: signed types as their value, unsigned ones up to 16 bits as well, and those of 32 bits as
the integer with the same bits. Results are cut to their width by masks and sign extension, as the
table of operations has it (`plcemu.ir.ops`). Integers of 64 bits are known only where they are
certain to be small, as indices are; REAL and LREAL are not known at all.

A value that cannot be said is not refused before something asks for it: what the cone of influence
cuts away may be anything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from plcemu.ir.ops import FLOATS, INTEGERS, VALUE_OPS

LARGEST = (1 << 31) - 1
"""The largest integer of Promela; the smallest is one less than its negative."""

WIDE = (*FLOATS, "i64", "u64")


@dataclass(frozen=True, slots=True)
class Term:
    """A value on its way.

    Attributes:
        text: it in Promela.
        machine: its machine type.
        op: the operator that binds its text: empty if none does.
        still: whether its text means the same after other statements.
        const: the value itself, where it is known.
        why: why it cannot be said in Promela; else empty.
        address: of a value that is an address: what it counts from, as candidates below.
        steps: of an address or a distance: (distance in Promela, the distances that it may be).
    """

    text: str
    machine: str
    op: str = ""
    still: bool = False
    const: int | None = None
    why: str = ""
    address: int | None = None
    steps: tuple[tuple[str, tuple[int, ...]], ...] = ()

    @property
    def inner(self) -> str:
        """The text as an operand."""
        return f"({self.text})" if self.op and self.op not in ("!", "~") else self.text


def number(value: int, machine: str) -> Term:
    """Return a constant; 32 unsigned bits as the integer with the same bits."""
    held = value - (1 << 32) if machine == "u32" and value > LARGEST else value
    if not -LARGEST - 1 <= held <= LARGEST:
        return unsaid(machine, f"the number {value} has more than 32 bits")
    text = f"({-LARGEST} - 1)" if held < -LARGEST else f"({held})" if held < 0 else str(held)
    return Term(text, machine, still=True, const=value)


def unsaid(machine: str, why: str) -> Term:
    """Return a value that Promela does not have."""
    return Term("", machine, why=why)


class Host(Protocol):
    """What the writer of statements does for operations; see `code`."""

    def plain(self, term: Term) -> Term:
        """Return the value as a name or a number, put into a variable if need be."""

    def fault_if(self, condition: str, reason: str) -> None:
        """Stop the program where a condition holds."""


def operate(name: str, operands: list[Term], host: Host) -> Term:
    """Return the result of an operation on values."""
    row = VALUE_OPS[name]
    stem, _, rest = name.partition(".")
    if stem == "to":
        return _converted(operands[0], rest.partition(".")[2])
    missing = next((o.why for o in operands if o.why), "")
    wide = [m for m in (*row.pops, row.pushes) if m in WIDE]
    if not missing and wide and (stem not in _COMPARED or wide[0] in FLOATS):
        missing = f"{name} on {wide[0]}"
    if missing:
        return unsaid(row.pushes, missing)
    return _TABLE[stem](row.pops[0], operands, host)


def cut(text: str, op: str, machine: str) -> Term:
    """Return a value of any size cut to a machine type."""
    inner = f"({text})" if op else text
    if machine in ("i32", "u32"):
        return Term(text, machine, op)
    bits, signed = (8, False) if machine == "bool" else INTEGERS[machine]
    mask = (1 << bits) - 1
    if not signed:
        return Term(f"{inner} & {mask}", machine, "&")
    half = 1 << bits - 1
    return Term(f"(({inner} & {mask}) ^ {half}) - {half}", machine, "-")


# ---------------------------------------------------------------- conversions


def _converted(value: Term, target: str) -> Term:
    source = value.machine
    if value.why or source in FLOATS or target in FLOATS:
        return unsaid(target, value.why or f"a value of type {source} as {target}")
    if value.const is not None and target != "bool":
        row = VALUE_OPS[f"to.{source}.{target}"]
        return number(int(row.fn(value.const)), target)
    if target == "bool":
        return Term(f"{value.inner} != 0", "bool", "!=")
    if target in WIDE:
        return _widened(value, target)
    if source == "bool" or _fits(source, target):
        return Term(value.text, target, value.op, value.still)
    result = cut(value.text, value.op, target)
    return Term(result.text, target, result.op, value.still)


def _widened(value: Term, target: str) -> Term:
    """Return a value as an integer of 64 bits, if it is the same one."""
    if value.machine == "u32" or (target == "u64" and _signed(value.machine)):
        return unsaid(target, f"a value of type {value.machine} as {target}")
    return Term(value.text, target, value.op, value.still)


def _signed(machine: str) -> bool:
    return machine != "bool" and INTEGERS[machine][1]


def _fits(source: str, target: str) -> bool:
    """Whether every value of one type is held the same way in the other."""
    if source in WIDE:
        return target == "i32" or target == "u32"
    one, other = INTEGERS[source], INTEGERS[target]
    if other[0] == 32:
        return True
    return one[0] + (not one[1]) <= other[0] + (not other[1]) and (one[1] <= other[1])


# ---------------------------------------------------------------- arithmetic

Translation = Callable[[str, list[Term], Host], Term]


def _ring(sign: str) -> Translation:
    return lambda m, o, host: cut(f"{o[0].inner} {sign} {o[1].inner}", sign, m)


def _negation(m: str, o: list[Term], host: Host) -> Term:
    return cut(f"0 - {o[0].inner}", "-", m)


def _absolute(m: str, o: list[Term], host: Host) -> Term:
    if not _signed(m):
        return o[0]
    a = host.plain(o[0]).text
    return cut(f"({a} < 0 -> 0 - {a} : {a})", "", m)


def _quotient(sign: str) -> Translation:
    """Return a division towards zero. The smallest integer by -1 must not reach the processor."""
    reason = "division by zero" if sign == "/" else "division by zero in MOD"

    def translation(m: str, o: list[Term], host: Host) -> Term:
        a, b = host.plain(o[0]).text, host.plain(o[1]).text
        if o[1].const in (None, 0):
            host.fault_if(f"{b} == 0", reason)
        if m == "u32":
            return _unsigned(sign, a, b, host)
        if m == "i32":
            alone = f"0 - {a}" if sign == "/" else "0"
            return Term(f"({b} == -1 -> {alone} : {a} {sign} {b})", m)
        return cut(f"{a} {sign} {b}", sign, m)
    return translation


def _unsigned(sign: str, a: str, b: str, host: Host) -> Term:
    """Return a division of 32 unsigned bits: by halves, as the integers are signed.

    The quotient of half the dividend, doubled, is right or one too small. A divisor of 2^31 or more
    goes into the dividend once or not at all.
    """
    half = f"(({a} >> 1) & {LARGEST}) / {b}"
    q = host.plain(Term(f"({b} < 0 -> 0 : ({half}) << 1)", "u32")).text
    r = host.plain(Term(f"{a} - {q} * {b}", "u32", "-")).text
    more = f"{_ordered(r)} >= {_ordered(b)}"
    if sign == "/":
        return Term(f"{q} + ({more} -> 1 : 0)", "u32", "+")
    return Term(f"({more} -> {r} - {b} : {r})", "u32")


def _ordered(text: str) -> str:
    """Return 32 unsigned bits as an integer of the same order."""
    return f"({text} ^ ({-LARGEST} - 1))"


# ---------------------------------------------------------------- logic and comparisons


def _comparison(sign: str) -> Translation:
    def translation(m: str, o: list[Term], host: Host) -> Term:
        if m == "u32" and sign not in ("==", "!="):
            return Term(f"{_ordered(o[0].text)} {sign} {_ordered(o[1].text)}", "bool", sign)
        return Term(f"{o[0].inner} {sign} {o[1].inner}", "bool", sign)
    return translation


def _bitwise(sign: str) -> Translation:
    logical = {"&": "&&", "|": "||", "^": "!="}[sign]

    def translation(m: str, o: list[Term], host: Host) -> Term:
        op = logical if m == "bool" else sign
        left = o[0].text if o[0].op == op and op != "!=" else o[0].inner
        return Term(f"{left} {op} {o[1].inner}", m, op)
    return translation


def _complement(m: str, o: list[Term], host: Host) -> Term:
    if m == "bool":
        return Term(f"!{o[0].inner}", m, "!")
    if m == "u32":
        return Term(f"~{o[0].inner}", m, "~")
    return Term(f"{o[0].inner} ^ {(1 << INTEGERS[m][0]) - 1}", m, "^")


def _shift(stem: str) -> Translation:
    def translation(m: str, o: list[Term], host: Host) -> Term:
        bits, (a, n) = INTEGERS[m][0], (host.plain(o[0]).text, host.plain(o[1]).text)
        host.fault_if(f"{n} < 0", "a shift by a negative number of bits")
        if stem in ("rol", "ror"):
            left = f"{n} % {bits}" if stem == "rol" else f"({bits} - {n} % {bits}) % {bits}"
            n = host.plain(Term(left, "i32", "%")).text
            return _rotated(m, a, n, bits)
        shifted = cut(f"{a} << {n}", "<<", m).text if stem == "shl" else _right(a, n, m)
        return Term(f"({n} < {bits} -> {shifted} : 0)", m)
    return translation


def _right(a: str, n: str, m: str) -> str:
    """Return a shift to the right that fills with zeros, by less than the width."""
    if m != "u32":
        return f"{a} >> {n}"
    return f"({n} == 0 -> {a} : (({a} >> 1) & {LARGEST}) >> ({n} - 1))"


def _rotated(m: str, a: str, n: str, bits: int) -> Term:
    left = cut(f"{a} << {n}", "<<", m)
    return Term(f"({n} == 0 -> {a} : ({left.text}) | ({_right(a, f'({bits} - {n})', m)}))", m)


_SIGNS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_COMPARED = tuple(_SIGNS)

_TABLE: dict[str, Translation] = {
    "add": _ring("+"), "sub": _ring("-"), "mul": _ring("*"),
    "div": _quotient("/"), "mod": _quotient("%"), "neg": _negation, "abs": _absolute,
    "and": _bitwise("&"), "or": _bitwise("|"), "xor": _bitwise("^"), "not": _complement,
    **{stem: _comparison(sign) for stem, sign in _SIGNS.items()},
    **{stem: _shift(stem) for stem in ("shl", "shr", "rol", "ror")},
}
