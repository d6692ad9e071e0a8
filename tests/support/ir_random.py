"""Random well-typed IR: every operation, any flow of control, addresses that stay in memory."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable
from typing import Any

from engines_compared import numbered, program_of

from plcemu.ir.builtins import BUILTINS, write_string
from plcemu.ir.ops import INTEGERS, MACHINE_TYPES, SIZES, STRUCT_CODES, VALUE_OPS, round_float
from plcemu.ir.program import ClockCell, Function, Instr, Program

DATA = 256
"""Bytes that the code reads and writes as it likes."""

CELLS = (256, 272)
STRINGS = (288, 336, 384, 432)
"""Where strings stand, each with room for `CAPACITY` characters."""

CAPACITY = 20
SIZE = 480
BASES = (0, 8, 32)

TEXTS = ("", "12", "-3", "16#ff", "4.5e3", "nan", "TRUE", "hello PLC", "T#1s500ms", "TOD#12:30:00",
         "D#2024-02-29", "DT#2024-02-29-12:30:00", "x" * CAPACITY, "h\u00e9\u00ff")

_BY_RESULT: dict[str, list[str]] = {m: [o for o in VALUE_OPS if VALUE_OPS[o].pushes == m]
                                    for m in MACHINE_TYPES}
_ASKERS: dict[str, list[str]] = {m: [b for b in BUILTINS if BUILTINS[b].pushes == m]
                                 for m in MACHINE_TYPES}
_MAKERS = [b for b in BUILTINS if not BUILTINS[b].pushes]


def edges(machine: str) -> list[Any]:
    """Return the values of a machine type at which things go wrong."""
    if machine == "bool":
        return [False, True]
    if machine in INTEGERS:
        bits, signed = INTEGERS[machine]
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        near = [v for v in (-33, -2, -1, 0, 1, 2, 3, 7, 8, 16, 31, 32, 63, 64, 100) if v >= low]
        return [low, low + 1, *near, high - 1, high]
    wide = [0.0, -0.0, 0.5, -0.5, 1.5, 2.5, -1.0, 3.25, 1e-40, -1e-310, 1e10, -32768.5,
            2147483648.0, 9.2233720368547758e18, -9.2233720368547758e18, 1.8446744073709552e19,
            3.4028234e38, 1e300, math.inf, -math.inf, math.nan, 16777217.0, 0.1, -7.0]
    return [round_float(v, machine) for v in wide]


def any_bits(machine: str, chance: random.Random) -> bytes:
    """Return bytes for a value in memory: an edge, or any bits, so also any NaN."""
    if machine != "bool" and chance.random() < 0.3:
        return chance.randbytes(SIZES[machine])
    return struct.pack("<" + STRUCT_CODES[machine], chance.choice(edges(machine)))


def image(chance: random.Random) -> bytes:
    """Return a memory of random data and valid strings."""
    block = bytearray(SIZE)
    block[:DATA] = chance.randbytes(DATA)
    for n, address in enumerate(STRINGS):
        write_string(block, address, CAPACITY, chance.choice(TEXTS), "sw"[n % 2])
    return bytes(block)


class Maker:
    """Makes one program; equal seeds make equal programs.

    Args:
        seed: of the random choices.
        flow: `forward`, or `any` for jumps backwards and into loops as well.
        bases: addresses of the instances that a function may run on.
    """

    def __init__(self, seed: int, flow: str = "any", bases: tuple[int, ...] = BASES) -> None:
        self.chance = random.Random(seed)
        self.flow, self.bases = flow, bases
        self.done: list[Function] = []
        self.code: list[Instr] = []
        self.locals: list[str] = []

    def program(self, functions: int = 4, statements: int = 12) -> Program:
        """Return a program whose functions call the earlier ones."""
        for n in range(functions):
            self.code, self.locals = [], self.chance.choices(MACHINE_TYPES, k=6)
            result = self.chance.choice(MACHINE_TYPES) if n % 3 == 1 else ""
            self._body(statements, result)
            self.done.append(Function(f"F{n}", numbered(self.code, 1000 * n), tuple(self.locals),
                                      result, f"POU {n}"))
        cells = [ClockCell(offset, n == 0) for n, offset in enumerate(CELLS)]
        return program_of(self.done, image(self.chance), cells, self.bases)

    def _body(self, statements: int, result: str) -> None:
        labels = self.chance.sample(range(statements + 1), k=self.chance.randrange(5))
        for n in range(statements + 1):
            if n in labels:
                self._put("label", n)
            if n < statements:
                self._statement(3)
                self._perhaps_jump([at for at in labels if self.flow == "any" or at > n])
            if self.chance.random() < 0.03:
                self._put("fault", f"reason {n}")
                self._put("label", 1000 + n)
        if result:
            self._value(result, 3)
        self._put("ret")

    def _perhaps_jump(self, labels: list[int]) -> None:
        if labels and self.chance.random() < 0.35:
            op = self.chance.choice(("jump", "jumpif", "jumpifnot", "jumpifnot", "jumpif"))
            if op != "jump":
                self._value("bool", 2)
            self._put(op, self.chance.choice(labels))

    def _put(self, op: str, arg: Any = None) -> None:
        self.code.append(Instr(op, arg))

    # ------------------------------------------------------------ statements

    def _statement(self, depth: int) -> None:
        self.chance.choice((self._store, self._store, self._set, self._storeat, self._copy,
                            self._drop, self._call, self._builtin))(depth)

    def _place(self, machine: str) -> tuple[str, int]:
        if self.chance.random() < 0.5:
            return "this", self.chance.randrange(DATA - max(BASES) - SIZES[machine])
        return "memory", self.chance.randrange(DATA - SIZES[machine])

    def _store(self, depth: int) -> None:
        machine = self.chance.choice(MACHINE_TYPES)
        self._value(machine, depth)
        self._put("store", (machine, *self._place(machine)))

    def _set(self, depth: int) -> None:
        local = self.chance.randrange(len(self.locals))
        self._value(self.locals[local], depth)
        self._put("set", local)

    def _storeat(self, depth: int) -> None:
        machine = self.chance.choice(MACHINE_TYPES)
        self._address(depth)
        self._value(machine, depth)
        self._put("storeat", (machine, self.chance.randrange(8)))

    def _address(self, depth: int) -> None:
        """Push the address of an element, far enough from the end of the data."""
        self._put("addr", (self.chance.choice(("this", "memory")), self.chance.randrange(140)))
        if depth > 0 and self.chance.random() < 0.6:
            low, size = self.chance.choice((0, 1, -3)), self.chance.choice((1, 2, 4, 8))
            if self.chance.random() < 0.7:
                self._put("const", ("i64", low + self.chance.randrange(6)))
            else:
                self._value("i64", depth - 1)
            self._put("index", (low, self.chance.choice((6, 7)), size))
            self._put("add.u32")

    def _copy(self, depth: int) -> None:
        self._address(depth)
        self._address(depth)
        self._put("copy", self.chance.choice((1, 2, 8, 16, 33)))

    def _drop(self, depth: int) -> None:
        self._value(self.chance.choice(MACHINE_TYPES), depth)
        self._put("drop")

    def _call(self, depth: int) -> None:
        callees = [f for f in self.done if not f.result]
        if callees:
            self._put("addr", ("memory", self.chance.choice(BASES)))
            self._put("call", self.chance.choice(callees).name)

    def _builtin(self, depth: int) -> None:
        self.builtin(self.chance.choice(_MAKERS), depth)

    def builtin(self, name: str, depth: int) -> None:
        """Push a built-in function's operands and run it."""
        row, kind = BUILTINS[name], name[-1]
        for n, machine in enumerate(row.pops):
            if machine == "u32":
                writes = name == "string.recode.sw" and n == 0
                reads = name == "string.recode.ws" and n == 2
                wide = (kind == "w" and not name.startswith("string.recode")) or writes or reads
                self._put("addr", ("memory", self.chance.choice(STRINGS[wide::2])))
            elif n == 1 and row.pops[0] == "u32":
                self._put("const", ("i64", self.chance.randrange(CAPACITY + 1)))
            elif (name, n) in _SMALL:
                self._put("const", ("i64", self.chance.randrange(_SMALL[name, n])))
            else:
                self._value(machine, depth - 1)
        self._put("builtin", name)

    # ------------------------------------------------------------ values

    def _value(self, machine: str, depth: int) -> None:
        if depth > 0 and self.chance.random() < 0.08:
            self._statement(0)  # while other values wait on the stack
        shapes: list[Callable[[str, int], None]] = [self._const, self._load, self._loadat]
        if machine in self.locals:
            shapes.append(self._get)
        if depth > 0:
            shapes = [self._operation] * 6 + [self._select, self._result, self._ask, *shapes]
        self.chance.choice(shapes)(machine, depth)

    def _const(self, machine: str, depth: int) -> None:
        self._put("const", (machine, self.chance.choice(edges(machine))))

    def _load(self, machine: str, depth: int) -> None:
        self._put("load", (machine, *self._place(machine)))

    def _loadat(self, machine: str, depth: int) -> None:
        self._address(depth)
        self._put("loadat", (machine, self.chance.randrange(8)))

    def _get(self, machine: str, depth: int) -> None:
        self._put("get", self.chance.choice([n for n, m in enumerate(self.locals) if m == machine]))

    def _operation(self, machine: str, depth: int) -> None:
        op = self.chance.choice(_BY_RESULT[machine])
        for operand in VALUE_OPS[op].pops:
            self._value(operand, depth - 1)
        self._put(op)

    def _select(self, machine: str, depth: int) -> None:
        for operand in (machine, machine, "bool"):
            self._value(operand, depth - 1)
        self._put("select", machine)

    def _result(self, machine: str, depth: int) -> None:
        callees = [f for f in self.done if f.result == machine]
        if callees:
            self._put("addr", ("memory", self.chance.choice(BASES)))
            self._put("call", self.chance.choice(callees).name)
        else:
            self._operation(machine, depth)

    def _ask(self, machine: str, depth: int) -> None:
        if _ASKERS[machine]:
            self.builtin(self.chance.choice(_ASKERS[machine]), depth)
        else:
            self._operation(machine, depth)


_SMALL = {("date.part", 1): 4, ("bcd.of", 1): 17}
"""Operands that the compiler makes, never a user: so many small numbers."""
