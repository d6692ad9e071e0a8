"""One function of IR as WebAssembly text."""

from __future__ import annotations

from typing import Any

from plcemu.engine.native import KINDS
from plcemu.engine.wat_flow import JUMPS, flow_of
from plcemu.engine.wat_ops import Helpers, Value, plain, translate
from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import FLOATS, SIZES, VALUE_OPS
from plcemu.ir.program import Function, Instr

_LOADS = {"bool": "i32.load8_u", "u8": "i32.load8_u", "i8": "i32.load8_s", "u16": "i32.load16_u",
          "i16": "i32.load16_s", "u32": "i32.load", "i32": "i32.load", "u64": "i64.load",
          "i64": "i64.load", "f32": "f32.load", "f64": "f64.load"}
_STORES = {1: "i32.store8", 2: "i32.store16", 4: "i32.store", 8: "i64.store"}


class FunctionWriter:
    """Translates one function.

    Args:
        function: it.
        functions: all of the program, by name.
        names: the WebAssembly name of each.
        origin: where the memory block begins in WebAssembly's memory.
        helpers: collects what the module needs besides.
    """

    def __init__(self, function: Function, functions: dict[str, Function], names: dict[str, str],
                 origin: int, helpers: Helpers) -> None:
        self._function, self._functions, self._names = function, functions, names
        self._origin, self._helpers = origin, helpers
        self._flow = flow_of(function.code)
        self._lines: list[str] = []
        self._stack: list[Value] = []
        self._places = {i.arg: n for n, i in enumerate(function.code) if i.op == "label"}
        self._place = ""
        self._site_of: dict[int, str] = {}

    def write(self) -> str:
        """Return the function's text."""
        code = self._function.code
        if self._flow.dispatched:
            self._open_dispatcher()
        for n, instr in enumerate(code):
            if self._flow.live[n]:
                self._comment(instr)
                self._instruction(instr, n)
                self._lines += ["end"] * self._flow.closes.get(n, 0)
        if self._flow.dispatched:
            self._lines.append("end")
        if not self._returns_at_end():
            self._lines.append("unreachable")
        return "\n".join([self._head(), *self._locals(), *_indented(self._lines), ")"])

    def _head(self) -> str:
        name, result = self._names[self._function.name], self._function.result
        return f"(func {name} (param $this i32)" + (f" (result {KINDS[result]})" if result else "")

    def _returns_at_end(self) -> bool:
        """Whether the last instruction is a return that needs no word for it."""
        return self._function.code[-1].op == "ret" and self._flow.live[-1] \
            and not self._flow.dispatched

    def _locals(self) -> list[str]:
        """Return the declarations; a temporary's name begins with its type, such as `$i32.0`."""
        own = [f"  (local ${n} {KINDS[m]})  ;; {m}" for n, m in enumerate(self._function.locals)]
        written = {line.split(" ")[1] for line in self._lines
                   if line.startswith(("local.tee $", "local.set $"))}
        return own + [f"  (local {name} {name[1:4]})" for name in sorted(written)
                      if not name[1].isdigit()]

    def _comment(self, instr: Instr) -> None:
        if instr.span is None:
            return
        source, start = instr.span.source, instr.span.start
        line, _ = source.position(start)
        place = f"{source.name}:{line}"
        if place != self._place and not self._stack:
            self._place = place
            text = source.text[source.text.rfind("\n", 0, start) + 1:].partition("\n")[0].strip()
            self._lines.append(f";; {place}: {text}"[:120])

    def _site(self, n: int) -> str:
        """Return the line that pushes the number of a place where the program can fault."""
        if n not in self._site_of:
            self._site_of[n] = f"i32.const {len(self._helpers.sites)}"
            self._helpers.sites.append((self._function.name, n))
        return self._site_of[n]

    # ------------------------------------------------------------ statements and values

    def _statement(self, lines: list[str]) -> None:
        """Emit lines that leave the stack as it was, after all that waits below."""
        for depth, value in enumerate(self._stack):
            if not value.still:
                name = f"${KINDS[value.machine]}.{depth}"
                self._lines += [*value.code, f"local.set {name}"]
                value.code, value.still = [f"local.get {name}"], True
        self._lines += lines

    def _open_blocks(self, n: int) -> None:
        self._lines += [f"block $L{label}" for label in self._flow.opens.get(n, ())]

    def _instruction(self, instr: Instr, n: int) -> None:
        op, arg = instr.op, instr.arg
        if op in VALUE_OPS:
            self._value_op(op, n)
        elif op in JUMPS:
            self._open_blocks(n)
            self._jump(op, arg, n)
        else:
            getattr(self, "_" + op)(arg, n)

    def _value_op(self, op: str, n: int) -> None:
        count = len(VALUE_OPS[op].pops)
        operands = self._stack[-count:]
        del self._stack[-count:]
        self._stack.append(translate(op, operands, self._helpers, lambda: self._site(n)))

    # One method an operation of `ops.STRUCTURAL`: its argument, and the instruction's number.

    def _const(self, arg: tuple[str, Any], n: int) -> None:
        machine, value = arg
        if machine in FLOATS:
            text = "nan" if value != value else float(value).hex()
        else:
            text = str(int(value))
        self._stack.append(Value(machine, [f"{KINDS[machine]}.const {text}"], const=value,
                                 still=True))

    def _load(self, arg: tuple[str, str, int], n: int) -> None:
        machine, base, offset = arg
        line = f"({_LOADS[machine]} offset={self._origin + offset} {_base(base)})"
        self._stack.append(Value(machine, [f"{line}  ;; {base}+{offset}"], raw=machine in FLOATS))

    def _store(self, arg: tuple[str, str, int], n: int) -> None:
        machine, base, offset = arg
        value = self._stack.pop()
        self._statement([_base(base), *self._to_store(value),
                         f"{_store(machine)} offset={self._origin + offset}  ;; {base}+{offset}"])

    def _to_store(self, value: Value) -> list[str]:
        return plain(value) if value.machine in FLOATS or value.offset else value.code

    def _addr(self, arg: tuple[str, int], n: int) -> None:
        base, offset = arg
        code = [_base("this")] if base == "this" else ["i32.const 0"]
        self._stack.append(Value("u32", code, offset=offset, still=True))

    def _loadat(self, arg: tuple[str, int], n: int) -> None:
        machine, offset = arg
        address = self._stack.pop()
        where = self._origin + address.offset + offset
        self._stack.append(Value(machine, [*address.code, f"{_LOADS[machine]} offset={where}"],
                                 raw=machine in FLOATS))

    def _storeat(self, arg: tuple[str, int], n: int) -> None:
        machine, offset = arg
        value, address = self._stack.pop(), self._stack.pop()
        where = self._origin + address.offset + offset
        self._statement([*address.code, *self._to_store(value),
                         f"{_store(machine)} offset={where}"])

    def _copy(self, arg: int, n: int) -> None:
        source, target = self._stack.pop(), self._stack.pop()
        self._statement([*plain(target), *plain(source), f"i32.const {arg}", "call $copy"])

    def _index(self, arg: tuple[int, int, int], n: int) -> None:
        low, count, size = arg
        value = self._stack.pop()
        if value.const is not None and 0 <= value.const - low < count:
            self._stack.append(Value("u32", [f"i32.const {(value.const - low) * size}"],
                                     still=True))
            return
        name, host = "$i64", self._helpers.host("index", ("i64",), "")
        away = [f"i64.const {low}", "i64.sub"] if low else []
        self._stack.append(Value("u32", [
            *value.code, f"local.tee {name}", *away, f"i64.const {count}", "i64.ge_u",
            "if", f"local.get {name}", self._site(n), host, "end",
            f"local.get {name}", "i32.wrap_i64",
            *([f"i32.const {_i32(low)}", "i32.sub"] if low else []),
            *([f"i32.const {size}", "i32.mul"] if size != 1 else [])]))

    def _select(self, arg: str, n: int) -> None:
        condition, otherwise, value = self._stack.pop(), self._stack.pop(), self._stack.pop()
        lines = [*plain(value), *plain(otherwise), *condition.code, "select"]
        self._stack.append(Value(arg, lines))

    def _builtin(self, arg: str, n: int) -> None:
        row = BUILTINS[arg]
        operands = self._stack[len(self._stack) - len(row.pops):]
        del self._stack[len(self._stack) - len(row.pops):]
        lines = [line for operand in operands for line in plain(operand)]
        lines += [self._site(n), self._helpers.host(arg, row.pops, row.pushes)]
        if row.pushes:
            self._stack.append(Value(row.pushes, lines))
        else:
            self._statement(lines)

    def _get(self, arg: int, n: int) -> None:
        self._stack.append(Value(self._function.locals[arg], [f"local.get ${arg}"]))

    def _set(self, arg: int, n: int) -> None:
        value = self._stack.pop()
        self._statement([*plain(value), f"local.set ${arg}"])

    def _drop(self, arg: None, n: int) -> None:
        value = self._stack.pop()
        self._statement([] if value.still else [*value.code, "drop"])

    def _call(self, arg: str, n: int) -> None:
        lines = [*plain(self._stack.pop()), f"call {self._names[arg]}"]
        result = self._functions[arg].result
        if result:
            self._stack.append(Value(result, lines))
        else:
            self._statement(lines)

    def _ret(self, arg: None, n: int) -> None:
        lines = plain(self._stack.pop()) if self._function.result else []
        last = n == len(self._function.code) - 1 and self._returns_at_end()
        self._statement(lines if last else [*lines, "return"])

    def _fault(self, arg: str, n: int) -> None:
        self._statement([self._site(n), self._helpers.host("fault", (), ""), "unreachable"])
        self._stack.clear()

    # ------------------------------------------------------------ jumps

    def _label(self, arg: int, n: int) -> None:
        if arg in self._flow.targets:
            self._lines.append(f"end  ;; $L{arg}")
        self._open_blocks(n)
        if arg in self._flow.loops:
            self._lines.append(f"loop $again{arg}")

    def _open_dispatcher(self) -> None:
        labels = [i.arg for i in self._function.code
                  if i.op == "label" and i.arg in self._flow.targets]
        self._lines += ["loop $dispatch", *(f"block $L{label}" for label in reversed(labels)),
                        "block $first", "local.get $i32.next", "br_table $first "
                        + " ".join(f"$L{label}" for label in self._flow.dispatched), "end"]

    def _jump(self, op: str, label: int, n: int) -> None:
        condition = self._stack.pop().code if op != "jump" else []
        target = self._places[label]
        if target > n:
            branch = {"jump": ["br"], "jumpif": ["br_if"], "jumpifnot": ["i32.eqz", "br_if"]}[op]
            self._statement([*condition, *branch[:-1], f"{branch[-1]} $L{label}"])
            return
        lines = self._spend(n - target, n) + self._back(label)
        if op == "jump":
            self._statement(lines)
        else:
            inverse = ["i32.eqz"] if op == "jumpifnot" else []
            self._statement([*condition, *inverse, "if", *lines, "end"])

    def _back(self, label: int) -> list[str]:
        if not self._flow.dispatched:
            return [f"br $again{label}"]
        return [f"i32.const {self._flow.dispatched.index(label) + 1}", "local.set $i32.next",
                "br $dispatch"]

    def _spend(self, cost: int, n: int) -> list[str]:
        if not cost:
            return []
        return ["global.get $left", f"i64.const {cost}", "i64.sub", "global.set $left",
                "global.get $left", "i64.const 0", "i64.lt_s",
                "if", "global.get $budget", self._site(n),
                self._helpers.host("overrun", ("i64",), ""), "end"]


def _base(base: str) -> str:
    return "(local.get $this)" if base == "this" else "(i32.const 0)"


def _store(machine: str) -> str:
    return f"{machine}.store" if machine in FLOATS else _STORES[SIZES[machine]]


def _i32(value: int) -> int:
    """Return an integer as an i32 constant, by its low bits."""
    value &= 0xFFFFFFFF
    return value - (1 << 32) if value >> 31 else value


def _indented(lines: list[str]) -> list[str]:
    out, depth = [], 1
    for line in lines:
        word = line.split(" ", 1)[0]
        if word in ("end", "else"):
            depth -= 1
        out.append("  " * min(depth, 20) + line)
        if word in ("block", "loop", "if", "else"):
            depth += 1
    return out
