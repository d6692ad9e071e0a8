"""The cone of influence: which bytes of memory can matter to outputs and properties at all.

A static analysis of the compiled program. Each store says on which bytes the stored value depends;
whatever decides a jump or may fault matters in any case. Starting from the bytes that are asked
about, everything that flows into them is added; the rest - a counter that nothing looks at, a step
time that nobody reads - cannot influence a run and is cut away.

The analysis gives up, and keeps everything, where a program reaches memory through addresses that
are not known before it runs (VAR_IN_OUT, strings). An element of an array may be any of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from plcemu.ir.ops import SIZES, VALUE_OPS
from plcemu.ir.program import Function, Instr, Program

_CLOCK_BYTES = 16
MAY_FAULT = frozenset(("div", "mod", "shl", "shr", "rol", "ror", "trunc", "to"))


class Indirect(Exception):
    """Memory is reached through an address that is not known."""


class Value(NamedTuple):
    """What is known of a value.

    Attributes:
        bytes: those it depends on.
        address: the least address that it may be; None if it is none.
        span: how much further the address may be, or how large the distance into an array.
        about: what another analysis that walks the same way knows of it.
    """

    bytes: frozenset[int] = frozenset()
    address: int | None = None
    span: int | None = None
    about: Any = None


NOTHING = Value()


@dataclass(slots=True)
class Flow:
    """What flows where: stores as (bytes written, bytes they depend on), and what decides."""

    program: Program
    stores: set[tuple[int, int, frozenset[int]]] = field(default_factory=set)
    decides: set[int] = field(default_factory=set)
    results: dict[tuple[str, int], Value] = field(default_factory=dict)
    locals: dict[tuple[str, int], dict[int, Value]] = field(default_factory=dict)
    active: set[tuple[str, int]] = field(default_factory=set)

    def walk(self, this: int, known: dict[int, Value], key: tuple[str, int]) -> Walk:
        """Return what walks through a function; other analyses walk in a way of their own."""
        return Walk(self, this, known, key)


def cone_of(program: Program, asked: Iterable[int]) -> frozenset[int] | None:
    """Return the bytes of memory that can influence the bytes asked about, those included.

    None if it cannot be told, and every byte must be taken to matter.
    """
    flow = Flow(program)
    try:
        for instance in program.instances:
            follow(flow, program.functions[instance.function], instance.base)
    except Indirect:
        return None
    for clock in program.layout.clocks:
        whole = frozenset(range(clock.offset, clock.offset + _CLOCK_BYTES))
        flow.stores.add((clock.offset, _CLOCK_BYTES, whole))
    for task in program.tasks:
        if task.event:
            flow.decides |= {task.event.trigger, task.event.seen}
    return _closure(flow, set(asked) | flow.decides)


def _closure(flow: Flow, relevant: set[int]) -> frozenset[int]:
    stores = list(flow.stores)
    writing: dict[int, list[int]] = {}
    for number, (offset, size, _) in enumerate(stores):
        for byte in range(offset, offset + size):
            writing.setdefault(byte, []).append(number)
    done: set[int] = set()
    todo = list(relevant)
    while todo:
        for number in writing.get(todo.pop(), ()):
            if number not in done:
                done.add(number)
                offset, size, depends = stores[number]
                new = depends.union(range(offset, offset + size)) - relevant
                relevant |= new
                todo.extend(new)
    return frozenset(relevant)


def follow(flow: Flow, function: Function, this: int) -> Value:
    """Walk through a function on the instance at an address; return what its result depends on.

    Stacks are empty at labels, so code is read in textual order; locals are taken to hold whatever
    was ever put into them, until nothing new comes.
    """
    key = (function.name, this)
    if key in flow.active:
        return flow.results.get(key, NOTHING)
    flow.active.add(key)
    known = flow.locals.setdefault(key, {})
    while True:
        before = dict(known)
        flow.walk(this, known, key).through(function)
        if known == before:
            break
    flow.active.discard(key)
    return flow.results.get(key, NOTHING)


class Walk:
    """One pass through a function with symbolic values."""

    def __init__(self, flow: Flow, this: int, known: dict[int, Value],
                 key: tuple[str, int]) -> None:
        self.flow, self.this, self.known, self.key = flow, this, known, key
        self.stack: list[Value] = []
        self.dead = False
        self.at = 0

    def through(self, function: Function) -> None:
        for self.at, instr in enumerate(function.code):
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
            self.stack.append(_element(op, operands, depends))
            return
        if op.split(".")[0] in MAY_FAULT:
            self.flow.decides |= depends
        self.stack.append(Value(depends))

    def place(self, base: str, offset: int) -> int:
        return offset + (self.this if base == "this" else 0)

    def read(self, machine: str, address: int, place: Value = NOTHING) -> None:
        end = address + (place.span or 0) + SIZES[machine]
        self.stack.append(Value(frozenset(range(address, end)) | place.bytes))

    def write(self, machine: str, address: int, value: Value, place: Value = NOTHING) -> None:
        if value.address is not None:
            raise Indirect
        size = (place.span or 0) + SIZES[machine]
        self.flow.stores.add((address, size, value.bytes | place.bytes))

    def known_address(self) -> tuple[int, Value]:
        place = self.stack.pop()
        if place.address is None:
            raise Indirect
        return place.address, place

    def op_const(self, instr: Instr) -> None:
        self.stack.append(NOTHING)

    def op_load(self, instr: Instr) -> None:
        machine, base, offset = instr.arg
        self.read(machine, self.place(base, offset))

    def op_store(self, instr: Instr) -> None:
        machine, base, offset = instr.arg
        self.write(machine, self.place(base, offset), self.stack.pop())

    def op_addr(self, instr: Instr) -> None:
        self.stack.append(Value(address=self.place(*instr.arg)))

    def op_loadat(self, instr: Instr) -> None:
        machine, offset = instr.arg
        address, place = self.known_address()
        self.read(machine, address + offset, place)

    def op_storeat(self, instr: Instr) -> None:
        machine, offset = instr.arg
        value = self.stack.pop()
        address, place = self.known_address()
        self.write(machine, address + offset, value, place)

    def op_copy(self, instr: Instr) -> None:
        (source, origin), (target, place) = self.known_address(), self.known_address()
        read = range(source, source + (origin.span or 0) + instr.arg)
        self.flow.stores.add((target, (place.span or 0) + instr.arg,
                              frozenset(read) | origin.bytes | place.bytes))

    def op_index(self, instr: Instr) -> None:
        _, count, size = instr.arg
        number = self.stack.pop()
        self.flow.decides |= number.bytes
        self.stack.append(Value(number.bytes, span=(count - 1) * size))

    def op_builtin(self, instr: Instr) -> None:
        raise Indirect

    def op_select(self, instr: Instr) -> None:
        operands = [self.stack.pop() for _ in range(3)]
        if any(v.address is not None for v in operands):
            raise Indirect
        self.stack.append(Value(frozenset().union(*(v.bytes for v in operands))))

    def op_get(self, instr: Instr) -> None:
        self.stack.append(self.known.get(instr.arg, NOTHING))

    def op_set(self, instr: Instr) -> None:
        value, before = self.stack.pop(), self.known.get(instr.arg)
        if value.address is not None:
            raise Indirect
        self.known[instr.arg] = Value(value.bytes | (before.bytes if before else frozenset()))

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
        address, place = self.known_address()
        if place.span:
            raise Indirect
        result = follow(self.flow, function, address)
        if function.result:
            self.stack.append(result)

    def op_ret(self, instr: Instr) -> None:
        if self.stack:
            result = self.stack[-1]
            if result.address is not None:
                raise Indirect
            before = self.flow.results.get(self.key, NOTHING)
            self.flow.results[self.key] = Value(before.bytes | result.bytes)
        self.dead = True

    def op_fault(self, instr: Instr) -> None:
        self.dead = True


def _element(op: str, operands: list[Value], depends: frozenset[int]) -> Value:
    """Return the address of an element: that of its array and a distance into it."""
    places = [v for v in operands if v.address is not None]
    distances = [v for v in operands if v.address is None and v.span is not None]
    if op != "add.u32" or len(places) != 1 or len(distances) != 1:
        raise Indirect
    place, distance = places[0], distances[0]
    return Value(depends, place.address, (place.span or 0) + (distance.span or 0))
