"""The fast engine: the program as WebAssembly, run by wasmtime on its own memory."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NoReturn

from plcemu.base.collector import paused_collector
from plcemu.base.errors import LimitError, ProgramFault
from plcemu.engine import native
from plcemu.engine.batch import Batch, PlainBatch, Shape
from plcemu.engine.interpreter import BUDGET, OUTSIDE
from plcemu.engine.native import Unavailable as Unavailable
from plcemu.engine.wasm_batch import WasmBatch
from plcemu.engine.wat import RUN_ROOM, Translated, translate_program
from plcemu.engine.wat_batch import COMPLETED
from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import VALUE_OPS, Fault, distance, overrun
from plcemu.ir.program import Block, Program

_RUN = struct.Struct("<II")
_COUNT = struct.Struct("<Q")
_NO_END = (1 << 64) - 1
"""More time than any clock cell can take."""


@lru_cache(maxsize=8)
@paused_collector()
def _compiled(program: Program) -> tuple[Translated, Any]:
    """Return a program's translation and machine code; forks of a PLC share them."""
    translated = translate_program(program)
    return translated, native.assemble(translated.text)


class WasmEngine:
    """Runs the functions of one program on the memory of one WebAssembly instance.

    Args:
        program: the compiled program.
        budget: see `plcemu.engine.interpreter.BUDGET`.
        direct: whether to use wasmtime's fast calls where it has them.
    """

    name = "wasm"

    def __init__(self, program: Program, budget: int = BUDGET, direct: bool = True) -> None:
        self._program = program
        self._budget = budget
        self._translated, module = _compiled(program)
        memory: list[memoryview] = []
        site: list[int] = []
        self._site = site
        self._machine = native.Machine(module, _hosts(program, self._translated, memory, site),
                                       direct)
        origin, size = self._translated.origin, program.layout.size
        self._head = self._machine.memory(0, origin)
        self._block = self._machine.memory(origin, size)
        self._block[:] = program.layout.initial
        memory.append(self._machine.memory(origin, size, owning=False))
        self._advance = self._machine.entry("advance", [0])
        self._clocks_run = self._machine.entry("clocks_run", [])
        self._lists: dict[tuple[tuple[str, int], ...], tuple[int, int]] = {}
        self._free = self._translated.runs
        self._codes: dict[tuple[str, int], WasmCode] = {}

    @property
    def block(self) -> Block:
        """The memory; it stands at the same place for the engine's whole life."""
        return self._block

    def run(self, function: str, base: int) -> None:
        """Run a function on the instance at an address; raises `ProgramFault`."""
        key = (function, base)
        if key not in self._codes:
            self._codes[key] = self.prepare([key])
        self._codes[key].run()

    def prepare(self, runs: Sequence[tuple[str, int]], budget: int | None = None) -> WasmCode:
        """Make functions, each on the instance at its address, ready to run.

        Raises:
            LimitError: there is no room for so many different lists of functions.
            ValueError: no program instance is at that address.
        """
        start, end = self._list(tuple(runs))
        budget = self._budget if budget is None else budget
        return WasmCode(self._machine, (start, end), budget, self._head, self._stop)

    def batch(self, runs: Sequence[tuple[str, int]], shape: Shape) -> Batch:
        """Make functions ready to run on many copies of memory."""
        try:
            return WasmBatch(self._machine, self._head, self._translated.room,
                             self._list(tuple(runs)), self._budget, shape, self._stop)
        except MemoryError:
            return PlainBatch(self._block, self.prepare(runs), shape)

    def _list(self, runs: tuple[tuple[str, int], ...]) -> tuple[int, int]:
        if runs not in self._lists:
            start, end = self._free, self._free + _RUN.size * len(runs)
            if end > self._translated.runs + RUN_ROOM:
                raise LimitError(f"the tasks run more than {RUN_ROOM // _RUN.size} program "
                                 "instances, the limit of the engine 'wasm'")
            for n, (function, base) in enumerate(runs):
                if self._translated.fixed.get(function, base) != base:
                    raise ValueError(f"{function} has no instance at {base}")
                _RUN.pack_into(self._head, start + _RUN.size * n,
                               self._translated.numbers[function], base)
            self._free, self._lists[runs] = end, (start, end)
        return self._lists[runs]

    def advance_clocks(self, elapsed_ns: int) -> None:
        """Let time pass: add it to every running clock cell, up to the cell's limit."""
        self._advance.set(0, min(elapsed_ns, _NO_END))
        self._advance.call()

    def clocks_run(self) -> bool:
        """Whether a clock cell runs that the program reads."""
        self._clocks_run.call()
        return bool(_COUNT.unpack_from(self._head, COMPLETED)[0])

    def _stop(self, stopped: native.Stopped) -> NoReturn:
        """Turn what stopped the code into the fault that the interpreter would have made."""
        site = self._site.pop() if self._site else None
        cause = stopped.cause
        if cause is None:
            raise ProgramFault(_TRAPS.get(str(stopped), str(stopped))) from None
        if site is None or not isinstance(cause, Fault | struct.error | IndexError | ValueError):
            raise cause
        function, at = self._translated.sites[site]
        code = self._program.functions[function]
        reason = str(cause) if isinstance(cause, Fault) else OUTSIDE
        raise ProgramFault(reason, pou=code.pou, place=code.place(at)) from None


_TRAPS = {"MEMORY_OUT_OF_BOUNDS": OUTSIDE, "UNREACHABLE": OUTSIDE,
          "STACK_OVERFLOW": "the calls nest too deeply"}


class WasmCode:
    """Functions on their instances, ready to run; see `plcemu.engine.engines.Code`."""

    __slots__ = ("_budget", "_count", "_elapsed", "_head", "_many", "_once", "_run", "_stop")

    def __init__(self, machine: native.Machine, runs: tuple[int, int], budget: int,
                 head: memoryview, stop: Callable[[native.Stopped], NoReturn]) -> None:
        self._head, self._stop = head, stop
        self._budget = budget
        self._once = machine.entry("repeat", [*runs, 1, 0, budget])
        self._many = machine.entry("repeat", [*runs, 1, 0, budget])
        self._count, self._elapsed = 1, 0
        self._run = self._once.call

    @property
    def budget(self) -> int:
        """Instructions that jumps backwards may cost in one run."""
        return self._budget

    @budget.setter
    def budget(self, budget: int) -> None:
        self._budget = budget
        for entry in (self._once, self._many):
            entry.set(4, budget)

    @property
    def completed(self) -> int:
        """How many whole runs the last call made."""
        count: int = _COUNT.unpack_from(self._head, COMPLETED)[0]
        return count

    def run(self) -> None:
        """Run it once; raises `ProgramFault`."""
        try:
            self._run()
        except native.Stopped as stopped:
            self._stop(stopped)

    def repeat(self, count: int, elapsed_ns: int) -> None:
        """So many times: let time pass for the clock cells, then run; raises `ProgramFault`."""
        if count != self._count or elapsed_ns != self._elapsed:
            self._count, self._elapsed = count, elapsed_ns
            self._many.set(2, count)
            self._many.set(3, min(elapsed_ns, _NO_END))
        try:
            self._many.call()
        except native.Stopped as stopped:
            self._stop(stopped)


def _hosts(program: Program, translated: Translated, memory: list[memoryview],
           site: list[int]) -> dict[str, native.Host]:
    """Return the functions that the code calls back; they note the site where they fail.

    They hold no reference to the machine, which holds them.
    """
    sites, functions = translated.sites, program.functions

    def argument(n: int) -> Any:
        function, at = sites[n]
        return functions[function].code[at].arg

    def fault(n: int) -> None:
        raise Fault(argument(n))

    def meaning(name: str) -> Callable[..., Any]:
        if name in VALUE_OPS:
            fn = VALUE_OPS[name].fn
            return lambda *operands: fn(*operands[:-1])
        if name in BUILTINS:
            builtin = BUILTINS[name].fn
            return lambda *operands: builtin(memory[0], *operands[:-1])
        own: dict[str, Callable[..., Any]] = {
            "index": lambda value, n: distance(value, *argument(n)), "fault": fault,
            "overrun": lambda budget, n: overrun(budget)}
        return own[name]

    def noting(fn: Callable[..., Any]) -> Callable[..., Any]:
        def run(*operands: Any) -> Any:
            try:
                return fn(*operands)
            except BaseException:
                site.append(operands[-1])
                raise
        return run
    return {name: native.Host(pops, pushes, noting(meaning(name)))
            for name, (pops, pushes) in translated.hosts.items()}
