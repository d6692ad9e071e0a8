"""The cone of influence: which bytes of memory can matter to outputs and properties at all.

A static analysis of the compiled program. Each store says on which bytes the stored value depends;
whatever decides a jump or may fault matters in any case. Starting from the bytes that are asked
about, everything that flows into them is added; the rest - a counter that nothing looks at, a step
time that nobody reads - cannot influence a run and is cut away.

The analysis gives up, and keeps everything, where a program reaches memory through addresses that
are not known before it runs (arrays, VAR_IN_OUT, strings).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from plcemu.ir.ops import SIZES, VALUE_OPS
from plcemu.ir.program import Function, Instr, Program

_CLOCK_BYTES = 16
_MAY_FAULT = frozenset(("div", "mod", "shl", "shr", "rol", "ror", "trunc", "to"))


class _Indirect(Exception):
    """Memory is reached through an address that is not known."""


class _Value(NamedTuple):
    """What is known of a value: the bytes it depends on, and the address that it is."""

    bytes: frozenset[int] = frozenset()
    address: int | None = None


_NOTHING = _Value()


@dataclass(slots=True)
class _Flow:
    """What flows where: stores as (bytes written, bytes they depend on), and what decides."""

    program: Program
    stores: set[tuple[int, int, frozenset[int]]] = field(default_factory=set)
    decides: set[int] = field(default_factory=set)
    results: dict[tuple[str, int], _Value] = field(default_factory=dict)
    locals: dict[tuple[str, int], dict[int, _Value]] = field(default_factory=dict)
    active: set[tuple[str, int]] = field(default_factory=set)


def cone_of(program: Program, asked: Iterable[int]) -> frozenset[int] | None:
    """Return the bytes of memory that can influence the bytes asked about, those included.

    None if it cannot be told, and every byte must be taken to matter.
    """
    flow = _Flow(program)
    try:
        for instance in program.instances:
            _follow(flow, program.functions[instance.function], instance.base)
    except _Indirect:
        return None
    for clock in program.layout.clocks:
        whole = frozenset(range(clock.offset, clock.offset + _CLOCK_BYTES))
        flow.stores.add((clock.offset, _CLOCK_BYTES, whole))
    for task in program.tasks:
        if task.event:
            flow.decides |= {task.event.trigger, task.event.seen}
    return _closure(flow, set(asked) | flow.decides)


def _closure(flow: _Flow, relevant: set[int]) -> frozenset[int]:
    sources: dict[int, set[int]] = {}
    for offset, size, depends in flow.stores:
        for byte in range(offset, offset + size):
            sources.setdefault(byte, set(range(offset, offset + size))).update(depends)
    todo = list(relevant)
    while todo:
        new = sources.get(todo.pop(), set()) - relevant
        relevant |= new
        todo.extend(new)
    return frozenset(relevant)


def _follow(flow: _Flow, function: Function, this: int) -> _Value:
    """Walk through a function on the instance at an address; return what its result depends on.

    Stacks are empty at labels, so code is read in textual order; locals are taken to hold whatever
    was ever put into them, until nothing new comes.
    """
    key = (function.name, this)
    if key in flow.active:
        return flow.results.get(key, _NOTHING)
    flow.active.add(key)
    known = flow.locals.setdefault(key, {})
    while True:
        before = dict(known)
        _Walk(flow, this, known, key).through(function)
        if known == before:
            break
    flow.active.discard(key)
    return flow.results.get(key, _NOTHING)


class _Walk:
    """One pass through a function with symbolic values."""

    def __init__(self, flow: _Flow, this: int, known: dict[int, _Value],
                 key: tuple[str, int]) -> None:
        self.flow, self.this, self.known, self.key = flow, this, known, key
        self.stack: list[_Value] = []
        self.dead = False

    def through(self, function: Function) -> None:
        for instr in function.code:
            self.dead = self.dead and instr.op != "label"
            if self.dead:
                continue
            if instr.op in VALUE_OPS:
                self.value(instr.op)
            else:
                getattr(self, "op_" + instr.op)(instr)

    def value(self, op: str) -> None:
        operands = [self.stack.pop() for _ in VALUE_OPS[op].pops]
        depends = frozenset().union(*(v.bytes for v in operands))
        if any(v.address is not None for v in operands):
            raise _Indirect
        if op.split(".")[0] in _MAY_FAULT:
            self.flow.decides |= depends
        self.stack.append(_Value(depends))

    def place(self, base: str, offset: int) -> int:
        return offset + (self.this if base == "this" else 0)

    def read(self, machine: str, address: int) -> None:
        self.stack.append(_Value(frozenset(range(address, address + SIZES[machine]))))

    def write(self, machine: str, address: int, value: _Value) -> None:
        if value.address is not None:
            raise _Indirect
        self.flow.stores.add((address, SIZES[machine], value.bytes))

    def known_address(self) -> int:
        address = self.stack.pop().address
        if address is None:
            raise _Indirect
        return address

    def op_const(self, instr: Instr) -> None:
        self.stack.append(_NOTHING)

    def op_load(self, instr: Instr) -> None:
        machine, base, offset = instr.arg
        self.read(machine, self.place(base, offset))

    def op_store(self, instr: Instr) -> None:
        machine, base, offset = instr.arg
        self.write(machine, self.place(base, offset), self.stack.pop())

    def op_addr(self, instr: Instr) -> None:
        self.stack.append(_Value(address=self.place(*instr.arg)))

    def op_loadat(self, instr: Instr) -> None:
        machine, offset = instr.arg
        self.read(machine, self.known_address() + offset)

    def op_storeat(self, instr: Instr) -> None:
        machine, offset = instr.arg
        value = self.stack.pop()
        self.write(machine, self.known_address() + offset, value)

    def op_copy(self, instr: Instr) -> None:
        source, target = self.known_address(), self.known_address()
        for n in range(instr.arg):
            self.flow.stores.add((target + n, 1, frozenset((source + n,))))

    def op_index(self, instr: Instr) -> None:
        raise _Indirect

    def op_builtin(self, instr: Instr) -> None:
        raise _Indirect

    def op_select(self, instr: Instr) -> None:
        operands = [self.stack.pop() for _ in range(3)]
        if any(v.address is not None for v in operands):
            raise _Indirect
        self.stack.append(_Value(frozenset().union(*(v.bytes for v in operands))))

    def op_get(self, instr: Instr) -> None:
        self.stack.append(self.known.get(instr.arg, _NOTHING))

    def op_set(self, instr: Instr) -> None:
        value, before = self.stack.pop(), self.known.get(instr.arg)
        if value.address is not None:
            raise _Indirect
        self.known[instr.arg] = _Value(value.bytes | (before.bytes if before else frozenset()))

    def op_drop(self, instr: Instr) -> None:
        self.stack.pop()

    def op_label(self, instr: Instr) -> None:
        self.stack.clear()

    def op_jump(self, instr: Instr) -> None:
        self.dead = True

    def op_jumpif(self, instr: Instr) -> None:
        self.flow.decides |= self.stack.pop().bytes

    op_jumpifnot = op_jumpif

    def op_call(self, instr: Instr) -> None:
        function = self.flow.program.functions[instr.arg]
        result = _follow(self.flow, function, self.known_address())
        if function.result:
            self.stack.append(result)

    def op_ret(self, instr: Instr) -> None:
        if self.stack:
            result = self.stack[-1]
            if result.address is not None:
                raise _Indirect
            before = self.flow.results.get(self.key, _NOTHING)
            self.flow.results[self.key] = _Value(before.bytes | result.bytes)
        self.dead = True

    def op_fault(self, instr: Instr) -> None:
        self.dead = True
