"""One function of IR as WebAssembly text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from plcemu.engine.wat_cells import Cells
from plcemu.engine.wat_flow import JUMPS, Flow, flow_of
from plcemu.engine.wat_lines import indented, temporaries, without_unread_copies
from plcemu.engine.wat_ops import KINDS, Helpers, Value, plain, translate
from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import FLOATS, SIZES, VALUE_OPS
from plcemu.ir.program import Function, Instr

_LOADS = {"bool": "i32.load8_u", "u8": "i32.load8_u", "i8": "i32.load8_s", "u16": "i32.load16_u",
          "i16": "i32.load16_s", "u32": "i32.load", "i32": "i32.load", "u64": "i64.load",
          "i64": "i64.load", "f32": "f32.load", "f64": "f64.load"}
INLINE_SIZE = 80
"""Instructions of a function that is still written out where it is called."""

INLINE_DEPTH = 3
INLINE_TOTAL = 8_000
"""Instructions that one function may grow by so."""

_STORES = {1: "i32.store8", 2: "i32.store16", 4: "i32.store", 8: "i64.store"}


@dataclass(slots=True)
class Frame:
    """A function whose code is being written: the one itself, or one that it calls.

    Attributes:
        function: it.
        flow: its structure.
        base: what its instance's address counts from.
        shift: how far its instance is from there.
        prefix: of its labels and locals; empty for the function itself.
    """

    function: Function
    flow: Flow
    base: str
    shift: int
    prefix: str

    @property
    def returns_at_end(self) -> bool:
        """Whether the last instruction is a return that needs no word for it."""
        return self.function.code[-1].op == "ret" and self.flow.live[-1] \
            and not self.flow.dispatched


class FunctionWriter:
    """Translates one function.

    Args:
        function: it.
        functions: all of the program, by name.
        names: the WebAssembly name of each.
        helpers: where the memory block stands; collects what the module needs besides.
        fixed: the address of the only instance it ever runs on, if there is one.
    """

    def __init__(self, function: Function, functions: dict[str, Function], names: dict[str, str],
                 helpers: Helpers, fixed: int | None = None) -> None:
        self._function, self._functions, self._names = function, functions, names
        self._origin, self._helpers = helpers.origin, helpers
        self._frame = self._frame_of(function, "this", 0) if fixed is None \
            else self._frame_of(function, "memory", fixed)
        self._lines: list[str] = []
        self._stack: list[Value] = []
        self._cells = Cells()
        self._falls = True
        self._place = ""
        self._depth = self._inlined = self._growth = 0

    def _frame_of(self, function: Function, base: str, shift: int, prefix: str = "") -> Frame:
        known = self._helpers.flows
        if function.name not in known:
            known[function.name] = flow_of(function.code)
        return Frame(function, known[function.name], base, shift, prefix)

    def write(self) -> str:
        """Return the function's text."""
        if self._frame.flow.dispatched:
            self._open_dispatcher()
        self._body()
        if self._frame.flow.dispatched:
            self._lines.append("end")
        if not self._frame.returns_at_end:
            self._lines.append("unreachable")
        self._lines = without_unread_copies(self._lines)
        return "\n".join([self._head(), *self._locals(), *indented(self._lines), ")"])

    def _body(self) -> None:
        flow = self._frame.flow
        for n, instr in enumerate(self._frame.function.code):
            if flow.live[n]:
                self._comment(instr)
                self._instruction(instr, n)
                self._lines += ["end"] * flow.closes.get(n, 0)
                self._falls = instr.op not in ("jump", "ret", "fault")

    def _head(self) -> str:
        name, result = self._names[self._function.name], self._function.result
        return f"(func {name} (param $this i32)" + (f" (result {KINDS[result]})" if result else "")

    def _locals(self) -> list[str]:
        own = [f"  (local ${n} {KINDS[m]})  ;; {m}" for n, m in enumerate(self._function.locals)]
        return own + temporaries(self._lines)

    def _comment(self, instr: Instr) -> None:
        if instr.span is None or self._stack:
            return
        source, start = instr.span.source, instr.span.start
        line, _ = source.position(start)
        place = f"{source.name}:{line}"
        if place != self._place:
            self._place = place
            text = source.text[source.text.rfind("\n", 0, start) + 1:].partition("\n")[0].strip()
            self._lines.append(f";; {place}: {text}"[:120])

    def _site(self, n: int) -> str:
        """Return the line that pushes the number of a place where the program can fault."""
        return f"i32.const {self._helpers.site(self._frame.function.name, n)}"

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
        self._lines += [f"block {self._label_name(label)}"
                        for label in self._frame.flow.opens.get(n, ())]

    def _label_name(self, label: int) -> str:
        return f"${self._frame.prefix}L{label}"

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
        machine, base, offset = self._cell(arg)
        name, raw = _copy_of(base, offset, machine), self._cells.find(base, offset, machine)
        if raw is not None:
            self._stack.append(Value(machine, [f"local.get {name}"], raw))
            return
        raw = machine in FLOATS
        self._cells.loaded(base, offset, machine, raw)
        line = f"({_LOADS[machine]} offset={self._origin + offset} {_base(base)})"
        self._stack.append(Value(machine, [f"{line}  ;; {base}+{offset}", f"local.tee {name}"],
                                 raw))

    def _cell(self, arg: tuple[str, str, int]) -> tuple[str, str, int]:
        """Return a cell as the outermost function sees it."""
        machine, base, offset = arg
        if base == "this":
            return machine, self._frame.base, self._frame.shift + offset
        return arg

    def _store(self, arg: tuple[str, str, int], n: int) -> None:
        machine, base, offset = self._cell(arg)
        value = self._stack.pop()
        self._statement([_base(base), *self._to_store(value),
                         f"local.tee {_copy_of(base, offset, machine)}",
                         f"{_store(machine)} offset={self._origin + offset}  ;; {base}+{offset}"])
        self._cells.stored(base, offset, machine, value.raw and machine not in FLOATS)

    def _to_store(self, value: Value) -> list[str]:
        return plain(value) if value.machine in FLOATS or value.offset else value.code

    def _addr(self, arg: tuple[str, int], n: int) -> None:
        _, base, offset = self._cell(("u32", *arg))
        code = ["(local.get $this)" if base == "this" else "i32.const 0"]
        self._stack.append(Value("u32", code, offset=offset, still=True, const=(base, offset)))

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
        self._cells.forget()

    def _copy(self, arg: int, n: int) -> None:
        source, target = self._stack.pop(), self._stack.pop()
        self._statement([*plain(target), *plain(source), f"i32.const {arg}", self._helpers.copy()])
        self._cells.forget()

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
            self._cells.forget()

    def _local(self, number: int) -> str:
        prefix, machine = self._frame.prefix, self._frame.function.locals[number]
        return f"${KINDS[machine]}.{prefix}{number}" if prefix else f"${number}"

    def _get(self, arg: int, n: int) -> None:
        self._stack.append(Value(self._frame.function.locals[arg],
                                 [f"local.get {self._local(arg)}"]))

    def _set(self, arg: int, n: int) -> None:
        value = self._stack.pop()
        self._statement([*plain(value), f"local.set {self._local(arg)}"])

    def _drop(self, arg: None, n: int) -> None:
        value = self._stack.pop()
        self._statement([] if value.still else [*value.code, "drop"])

    def _call(self, arg: str, n: int) -> None:
        address, callee = self._stack.pop(), self._functions[arg]
        if isinstance(address.const, tuple) and self._may_inline(callee):
            base, shift = address.const
            frame = self._frame_of(callee, base, shift, f"{self._names[arg][5:]}{self._inlined}.")
            if not frame.flow.dispatched:
                self._inline(frame)
                return
        lines = [*plain(address), f"call {self._names[arg]}"]
        if callee.result:
            self._stack.append(Value(callee.result, lines))
        else:
            self._statement(lines)
        self._cells.forget()

    def _may_inline(self, callee: Function) -> bool:
        return not callee.result and len(callee.code) <= INLINE_SIZE \
            and self._depth < INLINE_DEPTH and self._growth + len(callee.code) <= INLINE_TOTAL

    def _inline(self, frame: Frame) -> None:
        """Write a function out where it is called."""
        code, caller, waiting = frame.function.code, self._frame, self._stack
        self._statement([])
        self._frame, self._stack = frame, []
        self._depth, self._inlined = self._depth + 1, self._inlined + 1
        self._growth += len(code)
        for number, machine in enumerate(frame.function.locals):
            self._lines += [f"{KINDS[machine]}.const 0", f"local.set {self._local(number)}"]
        leaves = any(i.op == "ret" and frame.flow.live[n] for n, i in enumerate(code[:-1]))
        ending = f"${frame.prefix}end"
        if leaves:
            self._lines.append(f"block {ending}")
        self._body()
        if leaves:
            self._lines.append(f"end  ;; {ending}")
            self._cells.meet(ending, frame.returns_at_end)
        elif not frame.returns_at_end:
            self._lines.append("unreachable")
        self._frame, self._stack, self._depth = caller, waiting, self._depth - 1

    def _ret(self, arg: None, n: int) -> None:
        last = n == len(self._frame.function.code) - 1 and self._frame.returns_at_end
        if self._frame.prefix:
            if not last:
                self._statement([f"br ${self._frame.prefix}end"])
                self._cells.jump(f"${self._frame.prefix}end")
            return
        lines = plain(self._stack.pop()) if self._function.result else []
        self._statement(lines if last else [*lines, "return"])

    def _fault(self, arg: str, n: int) -> None:
        self._statement([self._site(n), self._helpers.host("fault", (), ""), "unreachable"])
        self._stack.clear()

    # ------------------------------------------------------------ jumps

    def _label(self, arg: int, n: int) -> None:
        flow, name = self._frame.flow, self._label_name(arg)
        self._cells.meet(name, self._falls)
        if arg in flow.targets:
            self._lines.append(f"end  ;; {name}")
        self._open_blocks(n)
        if arg in flow.loops:
            self._lines.append(f"loop {name}.again")
        if arg in flow.loops or flow.dispatched:
            self._cells.forget()

    def _open_dispatcher(self) -> None:
        flow = self._frame.flow
        labels = [i.arg for i in self._function.code if i.op == "label" and i.arg in flow.targets]
        self._lines += ["loop $dispatch", *(f"block $L{label}" for label in reversed(labels)),
                        "block $first", "local.get $i32.next", "br_table $first "
                        + " ".join(f"$L{label}" for label in flow.dispatched), "end"]

    def _jump(self, op: str, label: int, n: int) -> None:
        condition = self._stack.pop().code if op != "jump" else []
        target = self._frame.flow.places[label]
        if target > n:
            branch = {"jump": ["br"], "jumpif": ["br_if"], "jumpifnot": ["i32.eqz", "br_if"]}[op]
            name = self._label_name(label)
            self._statement([*condition, *branch[:-1], f"{branch[-1]} {name}"])
            self._cells.jump(name)
            return
        lines = self._spend(n - target, n) + self._back(label)
        if op == "jump":
            self._statement(lines)
        else:
            inverse = ["i32.eqz"] if op == "jumpifnot" else []
            self._statement([*condition, *inverse, "if", *lines, "end"])

    def _back(self, label: int) -> list[str]:
        if not self._frame.flow.dispatched:
            return [f"br {self._label_name(label)}.again"]
        return [f"i32.const {self._frame.flow.dispatched.index(label) + 1}", "local.set $i32.next",
                "br $dispatch"]

    def _spend(self, cost: int, n: int) -> list[str]:
        if not cost:
            return []
        return ["global.get $left", f"i64.const {cost}", "i64.sub", "global.set $left",
                "global.get $left", "i64.const 0", "i64.lt_s",
                "if", "global.get $budget", self._site(n),
                self._helpers.host("overrun", ("i64",), ""), "end"]


def _copy_of(base: str, offset: int, machine: str) -> str:
    """Return the name of the local that may hold a copy of a cell."""
    return f"${KINDS[machine]}.{base}+{offset}.{machine}"


def _base(base: str) -> str:
    return "(local.get $this)" if base == "this" else "(i32.const 0)"


def _store(machine: str) -> str:
    return f"{machine}.store" if machine in FLOATS else _STORES[SIZES[machine]]


def _i32(value: int) -> int:
    """Return an integer as an i32 constant, by its low bits."""
    value &= 0xFFFFFFFF
    return value - (1 << 32) if value >> 31 else value
