"""The compiled program as Promela statements: one scan, on memory cells that are variables.

A third translation of the IR beside the engines', for a judge that shares nothing with them. Calls
are written out, since the instance of each is known; forward jumps become alternatives where they
nest. An element at a computed index is picked among the cells that it may be.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.base.types import type_of
from plcemu.ir.ops import SIZES, STRUCT_CODES, VALUE_OPS, overrun
from plcemu.ir.ops import Fault as OpFault
from plcemu.ir.program import Function, Instr, Program
from plcemu.verify.promela.operations import WIDE, Host, Term, number, operate, unsaid

CANDIDATES = 256
"""Cells that an element at a computed index may be."""

STATEMENTS = 100_000
"""Instructions written, calls written out; more would be no model that SPIN can take."""

_TYPES = {"bool": "bit", "u8": "byte", "i8": "short", "i16": "short", "u16": "unsigned",
          "i32": "int", "u32": "int"}
_ADDRESS = "an address that is not known before the program runs"


class NoPromela(PlcemuError):
    """Something that matters cannot be said in Promela."""


@dataclass(slots=True)
class Cell:
    """A variable of the model that stands for some bytes of memory."""

    name: str
    machine: str
    initial: int
    offset: int

    def declared(self, name: str) -> str:
        """Return the declaration of a variable of that name for its values."""
        return f"{_TYPES[self.machine]} {name}" + (" : 16" if self.machine == "u16" else "")

    @property
    def declaration(self) -> str:
        """The line that declares it."""
        value = f" = {number(self.initial, self.machine).text}" if self.initial else ""
        return f"{self.declared(self.name)}{value};"


class Cells:
    """The variables that stand for memory, made as the code asks for them.

    Args:
        program: whose memory it is.
        kept: the bytes that matter; all if None.
    """

    def __init__(self, program: Program, kept: frozenset[int] | None) -> None:
        idle = {b for c in program.layout.clocks if not c.observed
                for b in range(c.offset, c.offset + 16)}
        self._kept = None if kept is None else kept - idle
        self._idle = idle
        self._initial = program.layout.initial
        self._names = {s.offset: s.tag.name for s in program.layout.slots
                       if type_of(s.tag.type).kind != "string"}
        self._at: dict[int, Cell] = {}
        self._owner: dict[int, Cell] = {}
        self.written: set[int] = set()

    def __iter__(self) -> Iterator[Cell]:
        return iter(sorted(self._at.values(), key=lambda cell: cell.offset))

    def matters(self, offset: int) -> bool:
        """Whether a byte matters to what is asked."""
        return offset not in self._idle if self._kept is None else offset in self._kept

    def at(self, offset: int, machine: str) -> Cell:
        """Return the variable of a cell.

        Raises:
            NoPromela: Promela has no such type, or the bytes are already part of another cell.
        """
        cell = self._at.get(offset)
        if cell is not None and cell.machine == machine:
            return cell
        name = self.name(offset)
        if machine in WIDE:
            raise NoPromela(f"{name} is of type {machine}")
        places = range(offset, offset + SIZES[machine])
        if any(place in self._owner for place in places):
            raise NoPromela(f"{name} is read or written as {machine} and as another type")
        value, = struct.unpack_from("<" + STRUCT_CODES[machine], self._initial, offset)
        cell = Cell(self._name(offset), machine, value, offset)
        self._at[offset] = cell
        self._owner.update(dict.fromkeys(places, cell))
        return cell

    def name(self, offset: int) -> str:
        """Return what stands at an offset, in the user's words."""
        return self._names.get(offset, f"byte {offset} of memory")

    def _name(self, offset: int) -> str:
        """Return the tag's whole name as an identifier; it cannot be a word of Promela or C."""
        known = self._names.get(offset)
        if known is None:
            return f"memory_{offset}"
        name = re.sub(r"[^A-Za-z0-9_]", "_", known)
        taken = {cell.name for cell in self._at.values()}
        return f"{name}_at_{offset}" if name in taken or "_" not in name.strip("_") else name


@dataclass(slots=True)
class _Frame:
    """A function that is being written.

    Attributes:
        function: it.
        this: the address of its instance.
        prefix: of its labels.
        places: the instruction of each label.
        uses: how many jumps to each label are left to be written.
        read: the local variables that are read at all, and have a type of Promela.
        first_local: the number of its first local variable.
        first_spare: the number of its first spare variable.
        stack: the values on their way.
        leaves: whether a `ret` jumps to its end.
        result: the variable of its result.
    """

    function: Function
    this: int
    prefix: str
    places: dict[int, int]
    uses: dict[int, int]
    read: set[int]
    first_local: int
    first_spare: int
    stack: list[Term] = field(default_factory=list)
    leaves: bool = False
    result: str = ""


class ScanWriter(Host):
    """Writes the runs of one scan.

    Args:
        program: the compiled program.
        cells: its memory.
        budget: instructions that jumps backwards may cost in one scan.

    Attributes:
        lines: what is written.
        faults: the reasons why the program may stop, with their places.
        spares: how many spare variables, `spare_0` and so on, are used.
        locals: how many variables for locals, `local_0` and so on, are used.
        loops: whether `budget_left` is used.
    """

    def __init__(self, program: Program, cells: Cells, budget: int) -> None:
        self.program, self.cells, self.budget = program, cells, budget
        self.lines: list[str] = []
        self.faults: list[str] = []
        self.spares = self.locals = 0
        self.loops = False
        self._depth = self._spare = self._local = self._inlined = self._written = 0
        self._frames: list[_Frame] = []
        self._place = ""
        self._at = 0

    def write(self, runs: Sequence[tuple[str, int]]) -> None:
        """Write functions on their instances, one after another.

        Raises:
            NoPromela: something that matters cannot be said in Promela.
        """
        for name, base in runs:
            self._function(self.program.functions[name], base)

    @property
    def _frame(self) -> _Frame:
        return self._frames[-1]

    @property
    def _stack(self) -> list[Term]:
        return self._frames[-1].stack

    # ------------------------------------------------------------ lines

    def put(self, line: str) -> None:
        """Write a line."""
        self.lines.append("  " * self._depth + line)

    def plain(self, term: Term) -> Term:
        """Return a value as a name or a number, put into a spare variable if need be."""
        if term.still and not term.op:
            return term
        name = f"spare_{self._spare}"
        self._spare += 1
        self.spares = max(self.spares, self._spare)
        self.put(f"{name} = {term.text};")
        return Term(name, term.machine, still=True)

    def fault_if(self, condition: str, reason: str) -> None:
        """Stop the program where a condition holds."""
        self.put(f"if :: {condition} -> {self._fault_text(reason)} :: else fi;")

    def _fault_text(self, reason: str) -> str:
        frame = self._frame
        place = frame.function.place(self._at)
        pou = f" in {frame.function.pou}" if frame.function.pou else ""
        self.faults.append(f"{reason}{pou}" + (f" at {place}" if place else ""))
        return f"fault = {len(self.faults)}; goto scanned"

    def _changes(self) -> None:
        """Put aside all values that wait, before memory changes."""
        for frame in self._frames:
            frame.stack[:] = [t if t.still or t.why or not t.text else self.plain(t)
                              for t in frame.stack]

    def _said(self, term: Term) -> str:
        """Return a value's text; raises NoPromela if it has none."""
        if term.why:
            instr = self._frame.function.code[self._at]
            place = f"{instr.span}: " if instr.span else ""
            raise NoPromela(f"{place}{term.why} cannot be said in Promela")
        return term.text

    def _comment(self, instr: Instr) -> None:
        if instr.span is None or self._stack:
            return
        source, start = instr.span.source, instr.span.start
        place = f"{source.name}:{source.position(start)[0]}"
        if place != self._place:
            self._place = place
            text = source.text[source.text.rfind("\n", 0, start) + 1:].partition("\n")[0].strip()
            short = place.rpartition("/")[2]
            self.put(f"/* {_harmless(f'{short}: {text}'[:100])} */")

    # ------------------------------------------------------------ functions and blocks

    def _function(self, function: Function, this: int) -> Term | None:
        """Write a function out; return the result, if it has one."""
        if len(self._frames) > 40:
            raise NoPromela(f"{function.pou}: calls nest too deeply")
        places = {i.arg: n for n, i in enumerate(function.code) if i.op == "label"}
        uses: dict[int, int] = {}
        for instr in function.code:
            if instr.op in ("jump", "jumpif", "jumpifnot"):
                uses[instr.arg] = uses.get(instr.arg, 0) + 1
        self._inlined += 1
        read = {i.arg for i in function.code
                if i.op == "get" and function.locals[i.arg] not in WIDE}
        frame = _Frame(function, this, f"c{self._inlined}_", places, uses, read, self._local,
                       self._spare)
        self._local += max(frame.read, default=-1) + 1
        self.locals = max(self.locals, self._local)
        if function.result:
            frame.result = f"spare_{self._spare}"
            frame.first_spare = self._spare = self._spare + 1
            self.spares = max(self.spares, self._spare)
        self._frames.append(frame)
        for n in sorted(frame.read):
            self.put(f"local_{frame.first_local + n} = 0;")
        self._block(0, len(function.code))
        if frame.leaves:
            self.put(f"{frame.prefix}end: skip;")
        self._frames.pop()
        self._local = frame.first_local
        self._spare = frame.first_spare
        return Term(frame.result, function.result, still=True) if function.result else None

    def _block(self, start: int, end: int) -> None:
        """Write the instructions from start up to end."""
        n, dead, code = start, False, self._frame.function.code
        while n < end:
            instr = code[n]
            dead = dead and instr.op != "label"
            if dead:
                n += 1
                continue
            self._written += 1
            if self._written > STATEMENTS:
                raise NoPromela(f"the program has more than {STATEMENTS:,} instructions, calls "
                                "written out")
            if not self._stack:
                self._spare = self._frame.first_spare
            self._at = n
            self._comment(instr)
            if instr.op in ("jumpif", "jumpifnot"):
                n = self._branch(instr, n, end)
                continue
            self._instruction(instr, n)
            dead = instr.op in ("jump", "ret", "fault")
            n += 1

    def _branch(self, instr: Instr, n: int, end: int) -> int:
        """Write a conditional jump: as alternatives where it nests. Return what comes next."""
        condition, frame = self._stack.pop(), self._frame
        self._said(condition)
        target = frame.places[instr.arg]
        stays = condition.text if instr.op == "jumpifnot" else f"!{condition.inner}"
        if not n < target <= end:
            goes = condition.text if instr.op == "jumpif" else f"!{condition.inner}"
            self.put(f"if :: {goes} ->")
            self._depth += 1
            self._jump(instr.arg, n)
            self._depth -= 1
            self.put(":: else fi;")
            return n + 1
        frame.uses[instr.arg] -= 1
        last = frame.function.code[target - 1]
        over = frame.places[last.arg] if last.op == "jump" else 0
        otherwise = last.op == "jump" and target <= over <= end and target - 1 > n
        self.put(f"if :: {stays} ->")
        self._depth += 1
        self._body(n + 1, target - 1 if otherwise else target)
        self._depth -= 1
        if otherwise:
            frame.uses[last.arg] -= 1
            self.put(":: else ->")
            self._depth += 1
            self._body(target, over)
            self._depth -= 1
            self.put("fi;")
            return over
        self.put(":: else fi;")
        return target

    def _body(self, start: int, end: int) -> None:
        """Write a block that must not be empty."""
        before = len(self.lines)
        self._block(start, end)
        if all(line.lstrip().startswith("/*") for line in self.lines[before:]):
            self.put("skip;")

    def _instruction(self, instr: Instr, n: int) -> None:
        if instr.op in VALUE_OPS:
            count = len(VALUE_OPS[instr.op].pops)
            operands = self._stack[-count:]
            del self._stack[-count:]
            self._stack.append(self._operation(instr.op, operands))
        else:
            getattr(self, "_" + instr.op)(instr.arg, n)

    def _operation(self, op: str, operands: list[Term]) -> Term:
        if op == "add.u32" and any(o.address is not None for o in operands):
            return _moved(*operands)
        known = [o.const for o in operands]
        if None not in known and VALUE_OPS[op].pushes not in ("f32", "f64"):
            try:
                return number(int(VALUE_OPS[op].fn(*known)), VALUE_OPS[op].pushes)
            except OpFault:
                pass
        result = operate(op, operands, self)
        if result.why and op.split(".")[0] in ("div", "mod", "shl", "shr", "rol", "ror", "trunc",
                                               "to") and _may_fault(op):
            self._said(result)
        return result

    # One method an operation of `ops.STRUCTURAL`: its argument, and the instruction's number.

    def _const(self, arg: tuple[str, Any], n: int) -> None:
        machine, value = arg
        self._stack.append(unsaid(machine, f"the number {value}") if isinstance(value, float)
                           else number(int(value), machine))

    def _load(self, arg: tuple[str, str, int], n: int) -> None:
        machine, base, offset = arg
        self._stack.append(self._read(machine, self._absolute(base, offset)))

    def _read(self, machine: str, offset: int) -> Term:
        if machine in WIDE or not self.cells.matters(offset):
            return unsaid(machine, f"{self.cells.name(offset)} of type {machine}")
        return Term(self._cell(offset, machine).name, machine)

    def _cell(self, offset: int, machine: str) -> Cell:
        try:
            return self.cells.at(offset, machine)
        except NoPromela as problem:
            instr = self._frame.function.code[self._at]
            place = f"{instr.span}: " if instr.span else ""
            raise NoPromela(f"{place}{problem}, which Promela does not have") from None

    def _absolute(self, base: str, offset: int) -> int:
        return self._frame.this + offset if base == "this" else offset

    def _store(self, arg: tuple[str, str, int], n: int) -> None:
        machine, base, offset = arg
        self._write(machine, self._absolute(base, offset), self._stack.pop())

    def _write(self, machine: str, offset: int, value: Term) -> None:
        if not self.cells.matters(offset):
            return
        name, text = self._cell(offset, machine).name, self._said(value)
        self._changes()
        self.cells.written.add(offset)
        self.put(f"{name} = {text};")

    def _addr(self, arg: tuple[str, int], n: int) -> None:
        self._stack.append(Term("", "u32", still=True, why=_ADDRESS, address=self._absolute(*arg)))

    def _index(self, arg: tuple[int, int, int], n: int) -> None:
        low, count, size = arg
        value = self._stack.pop()
        if value.const is not None and 0 <= value.const - low < count:
            self._stack.append(number((value.const - low) * size, "u32"))
            return
        self._said(value)
        name = self.plain(value).text
        outside = f"{name} < {low} || {name} > {low + count - 1}"
        self.fault_if(outside, f"an index is outside {low}..{low + count - 1}")
        away = f"{name} - {low}" if low >= 0 else f"{name} + {-low}"
        step = self.plain(Term(f"({away}) * {size}", "u32", "*")).text
        self._stack.append(Term(step, "u32", still=True,
                                steps=((step, tuple(range(0, count * size, size))),)))

    def _elements(self, offset: int) -> tuple[Term, str, list[tuple[int, int]]]:
        """Return an address popped, the text of its distance, and the cells that it may be."""
        place = self._stack.pop()
        if place.address is None:
            self._said(unsaid("u32", _ADDRESS))
        distance = " + ".join(text for text, _ in place.steps)
        sums = sorted({sum(row) for row in product(*(each for _, each in place.steps))})
        if len(sums) > CANDIDATES:
            self._said(unsaid("u32", f"an element of more than {CANDIDATES}"))
        if len(place.steps) > 1:
            distance = self.plain(Term(distance, "u32", "+")).text
        start = (place.address or 0) + offset
        return place, distance, [(away, start + away) for away in sums]

    def _loadat(self, arg: tuple[str, int], n: int) -> None:
        machine, offset = arg
        _, distance, cells = self._elements(offset)
        if machine in WIDE or not any(self.cells.matters(at) for _, at in cells):
            self._stack.append(unsaid(machine, f"a value of type {machine}"))
            return
        text = self._cell(cells[-1][1], machine).name
        for away, at in reversed(cells[:-1]):
            text = f"({distance} == {away} -> {self._cell(at, machine).name} : {text})"
        self._stack.append(Term(text, machine))

    def _storeat(self, arg: tuple[str, int], n: int) -> None:
        machine, offset = arg
        value = self._stack.pop()
        _, distance, cells = self._elements(offset)
        if len(cells) == 1:
            self._write(machine, cells[0][1], value)
            return
        kept = [(away, at) for away, at in cells if self.cells.matters(at)]
        if not kept:
            return
        names = [(away, self._cell(at, machine).name) for away, at in kept]
        text = self._said(value)
        self._changes()
        text = self.plain(Term(text, machine, value.op, value.still)).text
        self.put("if")
        for away, name in names:
            self.put(f":: {distance} == {away} -> {name} = {text}")
        self.put(":: else fi;")
        self.cells.written.update(at for _, at in kept)

    def _copy(self, arg: int, n: int) -> None:
        self._said(unsaid("u32", "copying a whole structure, array or string"))

    def _select(self, arg: str, n: int) -> None:
        condition, otherwise, value = (self._stack.pop() for _ in range(3))
        why = condition.why or otherwise.why or value.why
        self._stack.append(unsaid(arg, why) if why else Term(
            f"({condition.text} -> {value.text} : {otherwise.text})", arg))

    def _builtin(self, arg: str, n: int) -> None:
        self._said(unsaid("u32", f"{arg}, on strings or dates,"))

    def _get(self, arg: int, n: int) -> None:
        machine = self._frame.function.locals[arg]
        if machine in WIDE:
            self._stack.append(unsaid(machine, f"a value of type {machine}"))
        else:
            self._stack.append(Term(f"local_{self._frame.first_local + arg}", machine))

    def _set(self, arg: int, n: int) -> None:
        value = self._stack.pop()
        if arg not in self._frame.read:
            return
        text = self._said(value)
        self._changes()
        self.put(f"local_{self._frame.first_local + arg} = {text};")

    def _drop(self, arg: None, n: int) -> None:
        self._stack.pop()

    def _call(self, arg: str, n: int) -> None:
        place = self._stack.pop()
        if place.address is None or place.steps:
            self._said(unsaid("u32", _ADDRESS))
        self._changes()
        result = self._function(self.program.functions[arg], place.address or 0)
        self._at = n
        if result is not None:
            self._stack.append(result)

    def _ret(self, arg: None, n: int) -> None:
        frame = self._frame
        if frame.function.result:
            self.put(f"{frame.result} = {self._said(self._stack.pop())};")
        if n < len(frame.function.code) - 1:
            frame.leaves = True
            self.put(f"goto {frame.prefix}end;")

    def _fault(self, arg: str, n: int) -> None:
        self.put(self._fault_text(arg) + ";")
        self._stack.clear()

    def _label(self, arg: int, n: int) -> None:
        if self._frame.uses.get(arg, 0) > 0:
            self.put(f"{self._frame.prefix}L{arg}: skip;")

    def _jump(self, arg: int, n: int) -> None:
        target = self._frame.places[arg]
        if target <= n:
            self.loops = True
            self.put(f"budget_left = budget_left - {n - target};")
            try:
                overrun(self.budget)
            except OpFault as reason:
                self.fault_if("budget_left < 0", str(reason))
        self.put(f"goto {self._frame.prefix}L{arg};")


def _may_fault(op: str) -> bool:
    stem, source, *_ = op.split(".")
    return source in ("f32", "f64") and not op.endswith((".f32", ".f64", ".bool")) \
        if stem in ("to", "trunc") else source not in ("f32", "f64")


def _moved(one: Term, other: Term) -> Term:
    """Return an address and a distance together."""
    place, away = (one, other) if one.address is not None else (other, one)
    if away.const is not None:
        return Term("", "u32", still=True, why=_ADDRESS,
                    address=(place.address or 0) + away.const, steps=place.steps)
    if away.address is not None or not away.steps:
        return unsaid("u32", _ADDRESS)
    return Term("", "u32", still=True, why=_ADDRESS, address=place.address,
                steps=(*place.steps, *away.steps))


def _harmless(text: str) -> str:
    """Return a text that may stand in a comment."""
    return text.replace("/*", "/ *").replace("*/", "* /").replace("\\", "/")
