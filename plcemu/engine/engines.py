"""What an engine is, and which there are.

An engine owns the memory block of one resource and runs the program's functions on it. All engines
agree byte for byte, faults included; the interpreter says what is right.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Protocol

from plcemu.base.errors import PlcemuError
from plcemu.engine.batch import Batch, Shape
from plcemu.engine.interpreter import BUDGET, Interpreter
from plcemu.ir.program import Block, Program

_log = logging.getLogger(__name__)


class NoWebAssembly(PlcemuError):
    """This platform cannot run WebAssembly."""


class Code(Protocol):
    """Some functions on their instances, ready to run one after another: a task's work.

    Attributes:
        budget: instructions that jumps backwards may cost in one run of all of them; it may be
            set between runs.
        completed: how many whole runs the last call of `run` or `repeat` made.
    """

    budget: int

    @property
    def completed(self) -> int: ...

    def run(self) -> None:
        """Run it once; raises `ProgramFault`."""

    def repeat(self, count: int, elapsed_ns: int) -> None:
        """So many times: let time pass for the clock cells, then run.

        Raises:
            ProgramFault: `completed` runs were made before the one that failed.
        """


class Engine(Protocol):
    """What runs a program's functions on its memory block.

    Attributes:
        name: its name in the configuration.
        block: the memory, which stands at the same place for the engine's whole life.
    """

    name: str

    @property
    def block(self) -> Block: ...

    def run(self, function: str, base: int) -> None:
        """Run a function on the instance at an address; raises `ProgramFault`."""

    def prepare(self, runs: Sequence[tuple[str, int]], budget: int | None = None) -> Code:
        """Make functions, each on the instance at its address, ready to run (again and again)."""

    def batch(self, runs: Sequence[tuple[str, int]], shape: Shape) -> Batch:
        """Make functions, each on the instance at its address, ready to run on many copies of
        memory; `block` is lost when they do."""

    def advance_clocks(self, elapsed_ns: int) -> None:
        """Let time pass: add it to every running clock cell, up to the cell's limit."""

    def clocks_run(self) -> bool:
        """Whether a clock cell runs that the program reads."""


def _interpreter(program: Program, budget: int) -> Engine:
    return Interpreter(program, bytearray(program.layout.initial), budget)


def _wasm(program: Program, budget: int) -> Engine:
    try:
        # Not before it is needed: it takes a tenth of a second, and may be missing.
        from plcemu.engine.wasm import Unavailable, WasmEngine
    except (ImportError, OSError) as problem:
        raise NoWebAssembly(
            "the engine 'wasm' needs the package wasmtime, which cannot be imported here "
            f"({problem}); choose 'auto' or 'interpreter'") from None
    try:
        return WasmEngine(program, budget)
    except Unavailable as problem:
        raise NoWebAssembly(f"the engine 'wasm' cannot start here ({problem}); choose 'auto' or "
                            "'interpreter'") from None


def _fastest(program: Program, budget: int) -> Engine:
    try:
        return _wasm(program, budget)
    except NoWebAssembly as reason:
        _say_once(str(reason))
        return _interpreter(program, budget)


_said: set[str] = set()


def _say_once(reason: str) -> None:
    if reason not in _said:
        _said.add(reason)
        _log.warning("programs run in the interpreter, some hundred times slower: %s", reason)


_MAKERS: dict[str, Callable[[Program, int], Engine]] = {
    "auto": _fastest, "wasm": _wasm, "interpreter": _interpreter}

ENGINES = tuple(_MAKERS)
"""The engines to choose from; `auto` is the fastest that this platform has."""


def make_engine(name: str, program: Program, budget: int = BUDGET) -> Engine:
    """Return an engine with a memory block at its cold start.

    Args:
        name: one of `ENGINES`.
        program: the compiled program.
        budget: what `Code.budget` is where nothing else is said.

    Raises:
        PlcemuError: there is no engine of that name, or this platform does not have it.
    """
    if name not in _MAKERS:
        raise PlcemuError(f"there is no engine {name!r}; choose one of {', '.join(ENGINES)}")
    return _MAKERS[name](program, budget)
