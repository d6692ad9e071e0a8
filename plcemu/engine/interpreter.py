"""The readable engine: one Python closure an instruction, over the memory block.

It is the oracle that every faster engine is compared with.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, Protocol

from plcemu.base.collector import paused_collector
from plcemu.base.errors import PlcemuError, ProgramFault
from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import STRUCT_CODES, VALUE_OPS, Fault, wrap
from plcemu.ir.program import Function, Instr, Program

BUDGET = 1_000_000
"""Instructions that jumps backwards may cost in one run; a program that needs more has run away."""

_END = -1

_STRUCTS = {machine: struct.Struct("<" + code) for machine, code in STRUCT_CODES.items()}

Step = Callable[[list[Any], list[Any], int], int]
"""An instruction: takes stack, locals and the instance's address, returns what comes next."""


class Code(Protocol):
    def run(self) -> None: ...


class Engine(Protocol):
    name: str
    block: bytearray

    def prepare(self, runs: Sequence[tuple[str, int]], budget: int) -> Code: ...

    def advance_clocks(self, elapsed_ns: int) -> None: ...


_CLOCK = struct.Struct("<qq")
ENGINES = ("auto", "interpreter")


def make_engine(name: str, program: Program, budget: int) -> Engine:
    if name not in ENGINES:
        raise PlcemuError(f"there is no engine {name!r}; choose one of {', '.join(ENGINES)}")
    return Interpreter(program, bytearray(program.layout.initial), budget)


class InterpretedCode:
    def __init__(self, engine: Interpreter, runs: Sequence[tuple[str, int]], budget: int) -> None:
        self._engine, self._runs, self.budget = engine, runs, budget

    def run(self) -> None:
        engine = self._engine
        engine._left = engine._budget = self.budget
        for function, base in self._runs:
            engine._run(function, base, [])


class Interpreter:
    """Runs the functions of one program on one memory block.

    Args:
        program: the compiled program.
        block: its memory; changed in place.
        budget: see `BUDGET`.
    """

    name = "interpreter"

    @paused_collector()
    def __init__(self, program: Program, block: bytearray, budget: int = BUDGET) -> None:
        self._program = program
        self._block = self.block = block
        self._budget = budget
        self._left = budget
        self._code = {function.name: (function, self._steps(function), _zeros(function))
                      for function in program.functions.values()}

    def run(self, function: str, base: int) -> None:
        """Run a function on the instance at an address.

        Raises:
            ProgramFault: it did something undefined, or used up its budget.
        """
        self._left = self._budget
        self._run(function, base, [])

    def prepare(self, runs: Sequence[tuple[str, int]], budget: int) -> Code:
        return InterpretedCode(self, runs, budget)

    def advance_clocks(self, elapsed_ns: int) -> None:
        for clock in self._program.layout.clocks:
            elapsed, limit = _CLOCK.unpack_from(self._block, clock.offset)
            if elapsed < limit:
                _CLOCK.pack_into(self._block, clock.offset, min(elapsed + elapsed_ns, limit), limit)

    def _run(self, name: str, this: int, stack: list[Any]) -> None:
        function, steps, zeros = self._code[name]
        local = zeros[:]
        pc = before = 0
        try:
            while pc >= 0:
                before = pc
                pc = steps[pc](stack, local, this)
        except Fault as fault:
            self._stop(str(fault), function, before)

    def _stop(self, reason: str, function: Function, pc: int) -> NoReturn:
        span = next((i.span for i in reversed(function.code[:pc + 1]) if i.span), None)
        raise ProgramFault(reason, pou=function.pou, place=str(span or "")) from None

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
        block, unpack = self._block, _STRUCTS[machine].unpack_from
        relative = base == "this"

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
        return wide

    def _store(self, arg: tuple[str, str, int], following: int) -> Step:
        machine, base, offset = arg
        block, pack = self._block, _STRUCTS[machine].pack_into
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
        block, unpack = self._block, _STRUCTS[machine].unpack_from

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            stack[-1] = unpack(block, stack[-1] + offset)[0]
            return following
        return step

    def _storeat(self, arg: tuple[str, int], following: int) -> Step:
        machine, offset = arg
        block, pack = self._block, _STRUCTS[machine].pack_into

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            value = stack.pop()
            pack(block, stack.pop() + offset, value)
            return following
        return step

    def _copy(self, arg: int, following: int) -> Step:
        block = self._block

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            source = stack.pop()
            target = stack.pop()
            block[target:target + arg] = block[source:source + arg]
            return following
        return step

    def _index(self, arg: tuple[int, int, int], following: int) -> Step:
        low, count, size = arg

        def step(stack: list[Any], local: list[Any], this: int) -> int:
            place = stack[-1] - low
            if not 0 <= place < count:
                raise Fault(f"index {stack[-1]} is outside {low}..{low + count - 1}")
            stack[-1] = place * size
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
        row, block = BUILTINS[arg], self._block
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
            raise Fault(f"the scan does not end: jumps backwards cost over {self._budget} "
                        "instructions")


def _zeros(function: Function) -> list[Any]:
    return [0.0 if machine in ("f32", "f64") else 0 for machine in function.locals]


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
