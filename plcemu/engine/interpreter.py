"""The readable engine: one Python closure an instruction, over the memory block.

It is the oracle that every faster engine is compared with.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from plcemu.base.collector import paused_collector
from plcemu.base.errors import ProgramFault
from plcemu.engine.batch import Batch, PlainBatch, Shape
from plcemu.engine.clocks import advance_clocks, clocks_run
from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import FLOATS, STRUCT_CODES, VALUE_OPS, Fault, distance, overrun, wrap
from plcemu.ir.program import Block, Function, Instr, Program

BUDGET = 1_000_000
"""Instructions that jumps backwards may cost in one run; a program that needs more has run away."""

OUTSIDE = "an address outside memory"
"""The reason of a fault that only a damaged memory can bring about."""

_END = -1

OUTSIDE_ERRORS = (struct.error, IndexError, BufferError)

_STRUCTS = {machine: struct.Struct("<" + code) for machine, code in STRUCT_CODES.items()}

Step = Callable[[list[Any], list[Any], int], int]
"""An instruction: takes stack, locals and the instance's address, returns what comes next."""


class Interpreter:
    """Runs the functions of one program on one memory block.

    Args:
        program: the compiled program.
        block: its memory; changed in place.
        budget: see `BUDGET`.
    """

    name = "interpreter"

    @paused_collector()
    def __init__(self, program: Program, block: Block, budget: int = BUDGET) -> None:
        self.block = block
        self._view = memoryview(block)  # while it lives, nothing can change the block's length
        self._clocks = program.layout.clocks
        self._default = self._budget = self._left = budget
        self._code = {function.name: (function, self._steps(function), _zeros(function))
                      for function in program.functions.values()}

    def run(self, function: str, base: int) -> None:
        """Run a function on the instance at an address.

        Raises:
            ProgramFault: it did something undefined, or used up its budget.
        """
        self.run_all([(function, base)], self._default)

    def run_all(self, runs: Sequence[tuple[str, int]], budget: int) -> None:
        """Run functions on their instances, one after another, on one budget."""
        self._left = self._budget = budget
        for function, base in runs:
            self._run(function, base, [])

    def prepare(self, runs: Sequence[tuple[str, int]],
                budget: int | None = None) -> InterpretedCode:
        """Make functions, each on the instance at its address, ready to run."""
        return InterpretedCode(self, runs, self._default if budget is None else budget)

    def batch(self, runs: Sequence[tuple[str, int]], shape: Shape) -> Batch:
        """Make functions ready to run on many copies of memory."""
        return PlainBatch(self.block, self.prepare(runs), shape)

    def advance_clocks(self, elapsed_ns: int) -> None:
        """Let time pass: add it to every running clock cell, up to the cell's limit."""
        advance_clocks(self.block, self._clocks, elapsed_ns)

    def clocks_run(self) -> bool:
        """Whether a clock cell runs that the program reads."""
        return clocks_run(self.block, self._clocks)

    def _run(self, name: str, this: int, stack: list[Any]) -> None:
        function, steps, zeros = self._code[name]
        local = zeros[:]
        pc = before = 0
        try:
            while pc >= 0:
                before = pc
                pc = steps[pc](stack, local, this)
        except Fault as fault:
            _stop(str(fault), function, before)
        except OUTSIDE_ERRORS:
            _stop(OUTSIDE, function, before)

    def _steps(self, function: Function) -> list[Step]:
        labels = {i.arg: n for n, i in enumerate(function.code) if i.op == "label"}
        return [self._step(instr, n, labels) for n, instr in enumerate(function.code)]

    def _step(self, instr: Instr, n: int, labels: dict[int, int]) -> Step:
        if instr.op in VALUE_OPS:
            return _value_step(instr.op, n + 1)
        if instr.op in ("jump", "jumpif", "jumpifnot"):
            return self._jump(instr.op, n, labels[instr.arg])
        maker: Callable[[Any, int], Step] = getattr(self, "_" + instr.op)
        return maker(instr.arg, n + 1)

    # One method an operation of `ops.STRUCTURAL`: argument and next place in, the closure out.

    def _const(self, arg: tuple[str, Any], following: int) -> Step:
        value = arg[1]

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            stack.append(value)
            return following
        return step

    def _load(self, arg: tuple[str, str, int], following: int) -> Step:
        machine, base, offset = arg
        block, unpack = self.block, _STRUCTS[machine].unpack_from
        relative = base == "this"

        def real(stack: list[Any], local: list[Any], this: int) -> int:
            stack.append(_plain(unpack(block, this + offset if relative else offset)[0]))
            return following

        def byte(stack: list[Any], local: list[Any], this: int) -> int:
            stack.append(block[this + offset])
            return following

        def byte_absolute(stack: list[Any], local: list[Any], this: int) -> int:
            stack.append(block[offset])
            return following

        def wide(stack: list[Any], local: list[Any], this: int) -> int:
            stack.append(unpack(block, this + offset if relative else offset)[0])
            return following
        if machine in ("bool", "u8"):
            return byte if relative else byte_absolute
        return real if machine in FLOATS else wide

    def _store(self, arg: tuple[str, str, int], following: int) -> Step:
        machine, base, offset = arg
        block, pack = self.block, _STRUCTS[machine].pack_into
        relative = base == "this"

        def byte(stack: list[Any], local: list[Any], this: int) -> int:
            block[this + offset] = stack.pop()
            return following

        def byte_absolute(stack: list[Any], local: list[Any], this: int) -> int:
            block[offset] = stack.pop()
            return following

        def wide(stack: list[Any], local: list[Any], this: int) -> int:
            pack(block, this + offset if relative else offset, stack.pop())
            return following
        if machine in ("bool", "u8"):
            return byte if relative else byte_absolute
        return wide

    def _addr(self, arg: tuple[str, int], following: int) -> Step:
        base, offset = arg

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            stack.append(wrap(this + offset if base == "this" else offset, "u32"))
            return following
        return step

    def _loadat(self, arg: tuple[str, int], following: int) -> Step:
        machine, offset = arg
        block, unpack = self.block, _STRUCTS[machine].unpack_from

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            stack[-1] = unpack(block, stack[-1] + offset)[0]
            return following

        def real(stack: list[Any], local: list[Any], this: int) -> int:
            stack[-1] = _plain(unpack(block, stack[-1] + offset)[0])
            return following
        return real if machine in FLOATS else step

    def _storeat(self, arg: tuple[str, int], following: int) -> Step:
        machine, offset = arg
        block, pack = self.block, _STRUCTS[machine].pack_into

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            value = stack.pop()
            pack(block, stack.pop() + offset, value)
            return following
        return step

    def _copy(self, arg: int, following: int) -> Step:
        block = self.block

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            source = stack.pop()
            target = stack.pop()
            if max(source, target) + arg > len(block):
                raise Fault(OUTSIDE)
            block[target:target + arg] = block[source:source + arg]
            return following
        return step

    def _index(self, arg: tuple[int, int, int], following: int) -> Step:
        low, count, size = arg

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            stack[-1] = distance(stack[-1], low, count, size)
            return following
        return step

    def _select(self, arg: str, following: int) -> Step:
        def step(stack: list[Any], local: list[Any], this: int) -> int:
            condition, otherwise = stack.pop(), stack.pop()
            if not condition:
                stack[-1] = otherwise
            return following
        return step

    def _builtin(self, arg: str, following: int) -> Step:
        row, block = BUILTINS[arg], self.block
        count = len(row.pops)

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            operands = stack[len(stack) - count:]
            del stack[len(stack) - count:]
            result = row.fn(block, *operands)
            if row.pushes:
                stack.append(result)
            return following
        return step

    def _get(self, arg: int, following: int) -> Step:
        def step(stack: list[Any], local: list[Any], this: int) -> int:
            stack.append(local[arg])
            return following
        return step

    def _set(self, arg: int, following: int) -> Step:
        def step(stack: list[Any], local: list[Any], this: int) -> int:
            local[arg] = stack.pop()
            return following
        return step

    def _drop(self, arg: None, following: int) -> Step:
        def step(stack: list[Any], local: list[Any], this: int) -> int:
            stack.pop()
            return following
        return step

    def _label(self, arg: int, following: int) -> Step:
        def step(stack: list[Any], local: list[Any], this: int) -> int:
            return following
        return step

    def _ret(self, arg: None, following: int) -> Step:
        def step(stack: list[Any], local: list[Any], this: int) -> int:
            return _END
        return step

    def _fault(self, arg: str, following: int) -> Step:
        def step(stack: list[Any], local: list[Any], this: int) -> int:
            raise Fault(arg)
        return step

    def _call(self, arg: str, following: int) -> Step:
        run = self._run

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            run(arg, stack.pop(), stack)
            return following
        return step

    def _jump(self, op: str, n: int, target: int) -> Step:
        cost = n - target if target <= n else 0
        wanted = op == "jumpif"

        def always(stack: list[Any], local: list[Any], this: int) -> int:
            if cost:
                self._spend(cost)
            return target

        def conditional(stack: list[Any], local: list[Any], this: int) -> int:
            if bool(stack.pop()) is not wanted:
                return n + 1
            if cost:
                self._spend(cost)
            return target
        return always if op == "jump" else conditional

    def _spend(self, cost: int) -> None:
        self._left -= cost
        if self._left < 0:
            overrun(self._budget)


class InterpretedCode:
    """Functions on their instances, ready to run; see `plcemu.engine.engines.Code`."""

    def __init__(self, engine: Interpreter, runs: Sequence[tuple[str, int]], budget: int) -> None:
        self.budget = budget
        self.completed = 0
        self._engine = engine
        self._runs = list(runs)

    def run(self) -> None:
        """Run it once; raises `ProgramFault`."""
        self.repeat(1, 0)

    def repeat(self, count: int, elapsed_ns: int) -> None:
        """So many times: let time pass for the clock cells, then run; raises `ProgramFault`."""
        self.completed = 0
        for _ in range(count):
            if elapsed_ns:
                self._engine.advance_clocks(elapsed_ns)
            self._engine.run_all(self._runs, self.budget)
            self.completed += 1


def _stop(reason: str, function: Function, pc: int) -> NoReturn:
    raise ProgramFault(reason, pou=function.pou, place=function.place(pc)) from None


def _plain(value: float) -> float:
    """Return a float as it is, what is not a number as the one NaN that the machine knows."""
    return value if value == value else math.nan


def _zeros(function: Function) -> list[Any]:
    return [0.0 if machine in FLOATS else 0 for machine in function.locals]


def _value_step(op: str, following: int) -> Step:
    row = VALUE_OPS[op]
    fn = row.fn

    def unary(stack: list[Any], local: list[Any], this: int) -> int:
        stack[-1] = fn(stack[-1])
        return following

    def binary(stack: list[Any], local: list[Any], this: int) -> int:
        right = stack.pop()
        stack[-1] = fn(stack[-1], right)
        return following
    return unary if len(row.pops) == 1 else binary
