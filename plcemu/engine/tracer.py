"""The interpreter instruction by instruction: what each one read, stored and had as its result.

For debuggers and for the question why a tag has its value. A trace is exact: the instructions are
carried out by the interpreter's own code, and the faults are its faults.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from plcemu.base.errors import ProgramFault
from plcemu.base.spans import Span
from plcemu.base.types import Value
from plcemu.engine.interpreter import BUDGET, OUTSIDE, OUTSIDE_ERRORS, Interpreter
from plcemu.engine.memory import Memory
from plcemu.ir.builtins import BUILTINS, STRING_HEAD
from plcemu.ir.ops import SIZES, Fault
from plcemu.ir.program import Function, Instr, Program


class Access(NamedTuple):
    """Memory that an instruction read or wrote.

    Attributes:
        address: in the memory block.
        data: the bytes there, after the instruction.
        name: of the tag that they belong to; empty for memory that has no name.
        value: of that tag; of nameless memory the bytes.
    """

    address: int
    data: bytes
    name: str
    value: Value | bytes

    def __str__(self) -> str:
        shown = self.value.hex() if isinstance(self.value, bytes) else repr(self.value)
        return f"{self.name or f'memory[{self.address}]'} = {shown}"


class Event(NamedTuple):
    """One instruction that was carried out.

    Attributes:
        task: in which it ran.
        instance: the program or function block instance; empty for a function.
        pou: the POU, in the user's spelling.
        function: the function of IR, such as `MAIN.ACT`.
        pc: the instruction's place in it, from 0.
        instr: the instruction.
        activation: the number of the function's activation in this run, from 0.
        depth: how many calls deep, from 0.
        reads: what it read from memory.
        writes: what it wrote there.
        result: what it left on top of the stack; None for nothing.
        fault: why it could not be carried out; empty if it was.
    """

    task: str
    instance: str
    pou: str
    function: str
    pc: int
    instr: Instr
    activation: int
    depth: int
    reads: tuple[Access, ...]
    writes: tuple[Access, ...]
    result: Any
    fault: str

    @property
    def place(self) -> Span | None:
        """Where it was written; None for what no text stands for."""
        return self.instr.span

    @property
    def line(self) -> tuple[str, int] | None:
        """The source's name and the line, from 1."""
        span = self.instr.span
        return None if span is None else (span.source.name, span.source.position(span.start)[0])

    def __str__(self) -> str:
        arg = self.instr.arg
        operands = "" if arg is None else " ".join(map(str, arg)) if isinstance(arg, tuple) else arg
        text = f"{self.function}:{self.pc} {self.instr.op} {operands}".rstrip()
        parts = [f"reads {access}" for access in self.reads]
        parts += [f"writes {access}" for access in self.writes]
        if self.fault:
            parts.append(f"FAULT: {self.fault}")
        elif not parts and self.result is not None:
            parts.append(f"gives {self.result!r}")
        return f"{text}  ; {', '.join(parts)}" if parts else text


class TagMap:
    """Which tags stand where in a memory block."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        places = [(*memory.place(index), tag.name) for index, tag in enumerate(memory.tags)]
        self._slots = sorted(places, key=lambda slot: slot[0])
        self._offsets = [slot[0] for slot in self._slots]
        self._widest = max((slot[1].size for slot in self._slots), default=0)

    def accesses(self, address: int, size: int) -> tuple[Access, ...]:
        """Return the memory from an address on as it stands: each tag in it, and what is between.
        """
        block, end = self._memory.block, address + size
        found, at = [], address
        for n in range(bisect_right(self._offsets, address - self._widest),
                       bisect_right(self._offsets, end - 1)):
            offset, row, name = self._slots[n]
            if offset + row.size > address:
                if offset > at:
                    found.append(self._nameless(at, offset))
                at = max(at, offset + row.size)
                found.append(Access(offset, bytes(block[offset:offset + row.size]), name,
                                    row.unpack(block, offset)))
        if at < end:
            found.append(self._nameless(at, end))
        return tuple(found)

    def _nameless(self, begin: int, end: int) -> Access:
        data = bytes(self._memory.block[begin:end])
        return Access(begin, data, "", data)

    def instance_at(self, base: int, caller: str) -> str:
        """Return the name of the function block instance at an address, called from another."""
        n = bisect_right(self._offsets, base - 1)
        if n == len(self._slots):
            return ""
        name = self._slots[n][2]
        inner = name.removeprefix(caller + ".") if caller else name
        if inner == name or "." not in inner:
            return name.rpartition(".")[0]
        return f"{caller}.{inner.partition('.')[0]}"


@dataclass(slots=True)
class _Frame:
    """A function that runs: its code and where it stands."""

    function: Function
    steps: Sequence[Any]
    local: list[Any]
    this: int
    instance: str
    activation: int
    pc: int = 0


@dataclass(slots=True)
class _Touched:
    """What an instruction is about to touch: stretches of memory, as (address, size)."""

    reads: list[tuple[int, int]] = field(default_factory=list)
    writes: list[tuple[int, int]] = field(default_factory=list)


class Tracer(Interpreter):
    """An interpreter that tells of every instruction.

    Args:
        program: the compiled program.
        memory: of the resource; changed in place.
    """

    def __init__(self, program: Program, memory: Memory) -> None:
        super().__init__(program, memory.block)
        self._memory = memory
        self._map = TagMap(memory)
        self._instances = {(i.function, i.base): i.name for i in program.instances}

    def events(self, runs: Sequence[tuple[str, int]], task: str = "",
               budget: int = BUDGET) -> Iterator[Event]:
        """Run functions on the instances at their addresses, on one budget; yield what happens.

        Raises:
            ProgramFault: after the event that tells of it.
        """
        self._left = self._budget = budget
        activations = 0
        for name, base in runs:
            frames = [self._frame(name, base, self._instances.get((name, base), ""), activations)]
            activations += 1
            stack: list[Any] = []
            while frames:
                frame = frames[-1]
                at, instr = frame.pc, frame.function.code[frame.pc]
                touched = self._touched(instr, stack, frame.this)
                fault: ProgramFault | None = None
                if instr.op == "call":
                    target = stack.pop()
                    frame.pc += 1
                    frames.append(self._frame(instr.arg, target, self._callee(frame, target),
                                              activations))
                    activations += 1
                else:
                    fault = self._carry_out(frame, stack)
                yield Event(
                    task, frame.instance, frame.function.pou, frame.function.name, at, instr,
                    frame.activation, len(frames) - 1 - (instr.op == "call"),
                    self._seen(touched.reads), self._seen(touched.writes) if not fault else (),
                    stack[-1] if stack and instr.op != "call" else None,
                    fault.reason if fault else "")
                if fault is not None:
                    raise fault
                if frames[-1].pc < 0:
                    frames.pop()

    def _frame(self, name: str, base: int, instance: str, activation: int) -> _Frame:
        function, steps, zeros = self._code[name]
        return _Frame(function, steps, zeros[:], base, instance, activation)

    def _callee(self, caller: _Frame, target: int) -> str:
        if target == caller.this:
            return caller.instance
        return self._map.instance_at(target, caller.instance)

    def _carry_out(self, frame: _Frame, stack: list[Any]) -> ProgramFault | None:
        """Carry out any instruction but a call; return how it failed."""
        try:
            frame.pc = frame.steps[frame.pc](stack, frame.local, frame.this)
        except Fault as fault:
            return self._failure(frame, str(fault))
        except OUTSIDE_ERRORS:
            return self._failure(frame, OUTSIDE)
        return None

    @staticmethod
    def _failure(frame: _Frame, reason: str) -> ProgramFault:
        return ProgramFault(reason, pou=frame.function.pou, place=frame.function.place(frame.pc))

    def _touched(self, instr: Instr, stack: list[Any], this: int) -> _Touched:
        """Return what an instruction will touch, by its argument and the stack before it."""
        op, arg, touched = instr.op, instr.arg, _Touched()
        if op in ("load", "store"):
            place = (this + arg[2] if arg[1] == "this" else arg[2], SIZES[arg[0]])
            (touched.reads if op == "load" else touched.writes).append(place)
        elif op == "loadat":
            touched.reads.append((stack[-1] + arg[1], SIZES[arg[0]]))
        elif op == "storeat":
            touched.writes.append((stack[-2] + arg[1], SIZES[arg[0]]))
        elif op == "copy":
            touched.reads.append((stack[-1], arg))
            touched.writes.append((stack[-2], arg))
        elif op == "builtin":
            # What has no result makes a string: target, capacity, then operands. Other addresses
            # (u32) are of strings, whose heads are read; a tag there tells the rest.
            row = BUILTINS[arg]
            operands = stack[len(stack) - len(row.pops):]
            if not row.pushes:
                width = 2 if arg.endswith("w") else 1
                touched.writes.append((operands[0], STRING_HEAD + operands[1] * width))
            touched.reads += [(operand, STRING_HEAD) for operand, machine
                              in list(zip(operands, row.pops, strict=True))[not row.pushes:]
                              if machine == "u32"]
        return touched

    def _seen(self, places: Sequence[tuple[int, int]]) -> tuple[Access, ...]:
        return tuple(access for address, size in places
                     for access in self._map.accesses(address, size))
