"""The operations on values, as WebAssembly: the table that mirrors `plcemu.ir.ops`.

Integers of 8 and 16 bits live in an i32. An operation may leave it *raw*: the upper bits are then
anything, as addition does, until an operation needs them right. A float is raw while it may be any
NaN. What is stored narrow, or added again, never needs to be made plain.

Where an operation can fault, its exceptional case calls the host, which is the table itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from plcemu.engine.wat_flow import Flow
from plcemu.ir.ops import FLOATS, INTEGERS, VALUE_OPS

KINDS = {**dict.fromkeys(("bool", "i8", "i16", "i32", "u8", "u16", "u32"), "i32"),
         "i64": "i64", "u64": "i64", "f32": "f32", "f64": "f64"}
"""The WebAssembly type that holds a value of each machine type."""


@dataclass(slots=True)
class Value:
    """A value on its way: the lines that push it.

    Attributes:
        machine: its machine type.
        code: the lines.
        raw: whether it is yet to be made plain.
        const: the value itself where it is known; of an address, base and offset.
        offset: for an address: to be added to what the lines push.
        still: whether pushing it later gives the same.
    """

    machine: str
    code: list[str]
    raw: bool = False
    const: Any = None
    offset: int = 0
    still: bool = False


class Helpers:
    """What a module needs besides the program's functions: its helpers, host functions, places.

    Attributes:
        origin: where the program's memory block begins in WebAssembly's memory.
        size: of the block, in bytes.
        used: helper functions by name.
        hosts: imported functions by name: machine types taken and given.
        sites: the instruction of each site, as function and number in its code.
        flows: the structure of each function's code.
    """

    def __init__(self, origin: int, size: int) -> None:
        self.origin, self.size = origin, size
        self.used: dict[str, str] = {}
        self.hosts: dict[str, tuple[tuple[str, ...], str]] = {}
        self.sites: list[tuple[str, int]] = []
        self.flows: dict[str, Flow] = {}
        self._numbers: dict[tuple[str, int], int] = {}

    def site(self, function: str, at: int) -> int:
        """Return the number of a place where the program can fault."""
        if (function, at) not in self._numbers:
            self._numbers[function, at] = len(self.sites)
            self.sites.append((function, at))
        return self._numbers[function, at]

    def host(self, name: str, pops: tuple[str, ...], pushes: str) -> str:
        """Return the instruction that calls a host function; it takes a site last."""
        self.hosts[name] = ((*pops, "u32"), pushes)
        return f"call $host.{name}"

    def operation(self, name: str) -> str:
        """Return the instruction that lets the host do an operation of the table."""
        row = VALUE_OPS[name]
        return self.host(name, row.pops, row.pushes)

    def helper(self, name: str, signature: str, body: str) -> str:
        """Return the instruction that calls a helper function, made at its first use."""
        self.used.setdefault(name, f"(func ${name} {signature}\n{body})")
        return f"call ${name}"

    def copy(self) -> str:
        """Return the instruction that copies within the block: to, from, how many bytes.

        An address outside the block must not reach what stands before it.
        """
        return self.helper("copy", "(param $to i32) (param $from i32) (param $count i32)", f"""\
  (i32.or (i32.gt_u (local.get $to) (i32.sub (i32.const {self.size}) (local.get $count)))
          (i32.gt_u (local.get $from) (i32.sub (i32.const {self.size}) (local.get $count))))
  if
    unreachable
  end
  (memory.copy (i32.add (local.get $to) (i32.const {self.origin}))
               (i32.add (local.get $from) (i32.const {self.origin})) (local.get $count))""")


def bits(machine: str) -> int:
    """Return the width of an integer machine type; a BOOL is one byte."""
    return 8 if machine == "bool" else INTEGERS[machine][0]


def signed(machine: str) -> bool:
    """Whether an integer machine type is signed."""
    return machine != "bool" and INTEGERS[machine][1]


def plain(value: Value) -> list[str]:
    """Return lines that push a value made plain, and an address whole.

    They may use a temporary of the value's type, such as `$f32`; see `FunctionWriter`.
    """
    if value.offset:
        return [*value.code, f"i32.const {value.offset}", "i32.add"]
    if not value.raw:
        return value.code
    machine = value.machine
    if machine in FLOATS:
        return [*value.code, f"local.tee ${machine}", f"{machine}.const nan",
                f"local.get ${machine}", f"local.get ${machine}", f"{machine}.eq", "select"]
    if signed(machine):
        return [*value.code, f"i32.extend{bits(machine)}_s"]
    return [*value.code, f"i32.const {(1 << bits(machine)) - 1}", "i32.and"]


Site = Callable[[], str]
"""Returns the line that pushes the number of the place where the program can fault."""

Translation = Callable[[str, list[Value], Helpers, Site], Value]
"""Takes the rest of the operation's name, its operands, helpers and its site."""


def translate(name: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
    """Return the result of an operation on values."""
    stem, _, rest = name.partition(".")
    return _TABLE[stem](rest, operands, helpers, site)


def _narrow(machine: str) -> bool:
    return machine not in FLOATS and KINDS[machine] == "i32" and bits(machine) < 32


def _join(parts: Iterable[Value]) -> list[str]:
    """Return the lines of several values, raw as they are; the first one's list is reused."""
    first, *others = parts
    code = first.code
    for other in others:
        code += other.code
    return code


def _join_plain(parts: Iterable[Value]) -> list[str]:
    first, *others = parts
    code = plain(first)
    for other in others:
        code += plain(other)
    return code


def _ring(op: str) -> Translation:
    """Return addition, subtraction or multiplication: right in the low bits whatever is above."""
    def translation(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
        left, right = operands
        if op == "add" and left.offset and not right.offset:
            return Value(m, [*_join(operands), "i32.add"], offset=left.offset)
        code = _join_plain(operands) if left.offset or right.offset else _join(operands)
        return Value(m, [*code, f"{KINDS[m]}.{op}"], raw=m in FLOATS or _narrow(m))
    return translation


def _float_only(op: str, m: str, operands: list[Value]) -> Value:
    return Value(m, [*_join(operands), f"{m}.{op}"], raw=True)


def _quotient(op: str) -> Translation:
    def translation(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
        if m in FLOATS:
            return _float_only(op, m, operands)
        kind, sign = KINDS[m], "s" if signed(m) else "u"
        native = f"{kind}.{'div' if op == 'div' else 'rem'}_{sign}"
        code, raw = _join_plain(operands), _narrow(m) and signed(m) and op == "div"
        if operands[1].const not in (None, 0, -1):
            return Value(m, [*code, native], raw)
        return Value(m, [*code, site(), _divider(op, m, native, helpers)], raw)
    return translation


def _divider(op: str, m: str, native: str, helpers: Helpers) -> str:
    """Return a call of a division with its two edges: by zero, and the smallest integer by -1."""
    kind = KINDS[m]
    edge = f"""\
  local.get $b
  {kind}.const -1
  {kind}.eq
  if
    {kind}.const 0
    local.get $a
    {kind}.sub
    return
  end
""" if signed(m) and op == "div" else ""
    return helpers.helper(
        f"{op}.{m}", f"(param $a {kind}) (param $b {kind}) (param $site i32) (result {kind})",
        f"""\
  local.get $b
  {kind}.eqz
  if
    local.get $a
    local.get $b
    local.get $site
    {helpers.operation(f"{op}.{m}")}
    return
  end
{edge}  local.get $a
  local.get $b
  {native}""")


def _negation(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
    code = _join(operands)
    if m in FLOATS:
        return Value(m, [*code, f"{m}.neg"], raw=True)
    return Value(m, [f"{KINDS[m]}.const 0", *code, f"{KINDS[m]}.sub"], raw=_narrow(m))


def _absolute(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
    if m in FLOATS:
        return _float_only("abs", m, operands)
    if not signed(m):
        return operands[0]
    kind = KINDS[m]
    return Value(m, [*plain(operands[0]), f"local.tee ${kind}", f"{kind}.const 0",
                     f"local.get ${kind}", f"{kind}.sub", f"local.get ${kind}", f"{kind}.const 0",
                     f"{kind}.ge_s", "select"], raw=_narrow(m))


def _bitwise(op: str) -> Translation:
    def translation(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
        raw = any(o.raw for o in operands)
        return Value(m, [*_join(operands), f"{KINDS[m]}.{op}"], raw)
    return translation


def _complement(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
    ones = 1 if m == "bool" else -1
    return Value(m, [*_join(operands), f"{KINDS[m]}.const {ones}", f"{KINDS[m]}.xor"],
                 raw=_narrow(m) and m != "bool")


def _comparison(op: str) -> Translation:
    def translation(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
        if m in FLOATS:
            return Value("bool", [*_join(operands), f"{m}.{op}"])
        sign = "" if op in ("eq", "ne") else "_s" if signed(m) else "_u"
        return Value("bool", [*_join_plain(operands), f"{KINDS[m]}.{op}{sign}"])
    return translation


def _shift(op: str) -> Translation:
    def translation(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
        code, kind = _join_plain(operands), KINDS[m]
        lines = _shift_body(op, m)
        call = helpers.helper(
            f"{op}.{m}", f"(param $a {kind}) (param $n i32) (param $site i32) (result {kind})",
            f"""\
  local.get $n
  i32.const 0
  i32.lt_s
  if
    local.get $a
    local.get $n
    local.get $site
    {helpers.operation(f"{op}.{m}")}
    return
  end
""" + "\n".join("  " + line for line in lines))
        return Value(m, [*code, site(), call], raw=_narrow(m) and op != "shr")
    return translation


def _shift_body(op: str, m: str) -> list[str]:
    kind, width = KINDS[m], bits(m)
    count = ["local.get $n", *(["i64.extend_i32_u"] if kind == "i64" else [])]
    if op in ("shl", "shr"):
        native = f"{kind}.{op}_u" if op == "shr" else f"{kind}.shl"
        return ["local.get $a", *count, native, f"{kind}.const 0", "local.get $n",
                f"i32.const {width}", "i32.lt_u", "select"]
    if not _narrow(m):
        return ["local.get $a", *count, f"{kind}.rot{op[2]}"]
    one, other = ("shl", "shr_u") if op == "rol" else ("shr_u", "shl")
    mask = width - 1
    return ["local.get $a", "local.get $n", f"i32.const {mask}", "i32.and", f"i32.{one}",
            "local.get $a", f"i32.const {width}", "local.get $n", f"i32.const {mask}", "i32.and",
            "i32.sub", f"i32.{other}", "i32.or"]


def _hosted(stem: str) -> Translation:
    """Return an operation that only the host can do: its result must agree to the last bit."""
    def translation(m: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
        return Value(m, [*_join_plain(operands), site(), helpers.operation(f"{stem}.{m}")])
    return translation


def _truncation(rest: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
    source, _, target = rest.partition(".")
    return _to_integer("trunc", source, target, operands[0], helpers, site)


def _to_integer(stem: str, source: str, target: str, value: Value, helpers: Helpers,
                site: Site) -> Value:
    """Convert a float: in hardware where it fits 64 bits, else by the host, then wrap."""
    nearest = f"  {source}.nearest\n" if stem == "to" else ""
    promote = "  f64.promote_f32\n" if source == "f32" else ""
    call = helpers.helper(
        f"{stem}.{source}.i64", f"(param $x {source}) (param $site i32) (result i64)", f"""\
  local.get $x
  {source}.abs
  {source}.const 0x1p63
  {source}.lt
  if
    local.get $x
{"  " + nearest if nearest else ""}{"  " + promote if promote else ""}    i64.trunc_f64_s
    return
  end
  local.get $x
  local.get $site
  {helpers.operation(f"{stem}.{source}.i64")}""")
    return _wrapped(Value("i64", [*value.code, site(), call]), target)


def _wrapped(value: Value, target: str) -> Value:
    """Return an integer as another type of integer."""
    source = value.machine
    if KINDS[source] == "i64":
        if KINDS[target] == "i64":
            return Value(target, value.code)
        return Value(target, [*value.code, "i32.wrap_i64"], raw=_narrow(target))
    if KINDS[target] == "i64":
        return Value(target, [*plain(value), f"i64.extend_i32_{'s' if signed(source) else 'u'}"])
    widened = bits(target) > bits(source)
    right = _fits(source, target) and (widened or not value.raw)
    return Value(target, plain(value) if widened else value.code,
                 raw=_narrow(target) and not right)


def _fits(source: str, target: str) -> bool:
    """Whether every value of one integer type is one of the other."""
    if signed(source) and not signed(target):
        return False
    return bits(source) + (not signed(source)) <= bits(target) + (not signed(target))


def _conversion(rest: str, operands: list[Value], helpers: Helpers, site: Site) -> Value:
    source, _, target = rest.partition(".")
    value = operands[0]
    if source in FLOATS:
        if target in FLOATS:
            way = "f64.promote_f32" if target == "f64" else "f32.demote_f64"
            return Value(target, [*value.code, way], raw=True)
        if target == "bool":
            return Value("bool", [*value.code, f"{source}.const 0", f"{source}.ne"])
        return _to_integer("to", source, target, value, helpers, site)
    kind = KINDS[source]
    if target == "bool":
        return Value("bool", [*plain(value), f"{kind}.const 0", f"{kind}.ne"])
    if target in FLOATS:
        return Value(target, [*plain(value),
                              f"{target}.convert_{kind}_{'s' if signed(source) else 'u'}"])
    if value.offset:
        value = Value(source, plain(value))
    return _wrapped(value, target)


_TABLE: dict[str, Translation] = {
    **{op: _ring(op) for op in ("add", "sub", "mul")},
    **{op: _quotient(op) for op in ("div", "mod")},
    "neg": _negation, "abs": _absolute, "not": _complement,
    **{op: _bitwise(op) for op in ("and", "or", "xor")},
    **{op: _comparison(op) for op in ("eq", "ne", "lt", "le", "gt", "ge")},
    **{op: _shift(op) for op in ("shl", "shr", "rol", "ror")},
    "to": _conversion, "trunc": _truncation,
    "sqrt": lambda m, operands, helpers, site: _float_only("sqrt", m, operands),
    **{op: _hosted(op) for op in ("expt", "ln", "log", "exp", "sin", "cos", "tan", "asin", "acos",
                                  "atan")},
}
