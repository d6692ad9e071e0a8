"""What a program can see of its clocks: which constants it compares elapsed times with.

Integer time and zones are exact if all that a scan can learn from an elapsed time is whether it has
reached one of finitely many constants. A walk through the compiled program, beside that of the
cone of influence, follows elapsed times through stack, locals and memory. A copy may go anywhere;
as soon as one is calculated with, or compared with what is not known before the program runs, and
the outcome can matter, the walk says where, and time is not treated in this way.

`x >= c` and `x < c` are closed already. `x > c` is `x >= c + 1 ns`, since times are whole ns.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

from plcemu.base.areas import SIZES as WIDTHS
from plcemu.ir.ops import SIZES, VALUE_OPS, Fault
from plcemu.ir.program import ClockCell, Function, Instr, Program
from plcemu.verify.cone import MAY_FAULT, NOTHING, Flow, Indirect, Value, Walk, follow

NUMBERS_KEPT = 64
"""Different values that a place may have and still count as known."""

_LIMIT = 8
"""The distance of a clock cell's limit from its elapsed time."""

_NEVER = (1 << 63) - 1
"""The limit of a step's time, in ns: the largest TIME."""

_UNKNOWN = ("the program reaches memory through addresses that are not known before it runs "
            "(VAR_IN_OUT, strings)")

_SHIFTS = {"ge": 0, "lt": 0, "gt": 1, "le": 1}
"""Comparisons with a constant c, and how many ns beyond c they change."""

_MIRRORED = {"ge": "le", "le": "ge", "lt": "gt", "gt": "lt"}


@dataclass(frozen=True, slots=True)
class Clock:
    """A clock cell that matters, and when it does.

    Attributes:
        name: in the user's words.
        offset: of its elapsed time in the memory block.
        thresholds: the elapsed times, in ns and in order, at which a scan sees a difference.
    """

    name: str
    offset: int
    thresholds: tuple[int, ...]


class Lookout(NamedTuple):
    """What can be seen of the clocks, or why that cannot be told."""

    clocks: tuple[Clock, ...] = ()
    problems: tuple[str, ...] = ()
    copies: frozenset[int] = frozenset()
    """The bytes in which elapsed times, or copies of them, may stand."""


class _About(NamedTuple):
    """What a value may be.

    Attributes:
        numbers: the constants; None if it may be others.
        clocks: copies of the elapsed times of these cells.
        strange: what else was made of elapsed times, in words.
    """

    numbers: frozenset[int] | None = frozenset()
    clocks: frozenset[int] = frozenset()
    strange: frozenset[str] = frozenset()

    def joined(self, other: _About) -> _About:
        numbers = None if self.numbers is None or other.numbers is None \
            else self.numbers | other.numbers
        if numbers is not None and len(numbers) > NUMBERS_KEPT:
            numbers = None
        return _About(numbers, self.clocks | other.clocks, self.strange | other.strange)


_ANY = _About(None)
_ZERO = _About(frozenset((0,)))


@dataclass(slots=True)
class _ClockFlow(Flow):
    """What is known of places in memory, by offset and size, and what is found on the way."""

    cells: Mapping[int, ClockCell] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)
    kept: Collection[int] = ()
    places: dict[tuple[int, int], _About] = field(default_factory=dict)
    touched: dict[int, set[tuple[int, int]]] = field(default_factory=dict)
    thresholds: dict[int, set[int]] = field(default_factory=dict)
    problems: dict[str, None] = field(default_factory=dict)

    def walk(self, this: int, known: dict[int, Value], key: tuple[str, int]) -> Walk:
        return _ClockWalk(self, this, known, key)

    def put(self, address: int, size: int, about: _About) -> None:
        """Note that a place may hold a value."""
        key = address, size
        self.places[key] = self.places.get(key, _About()).joined(about)
        for byte in range(address, address + size):
            self.touched.setdefault(byte, set()).add(key)

    def get(self, address: int, size: int) -> _About:
        """Return what a place may hold: its initial value, and what is ever stored there."""
        layout = self.program.layout
        if any(e.area[0] == "I" and e.offset < address + size and
               address < e.offset + e.count * WIDTHS[e.area[1]] for e in layout.extents):
            return _ANY
        initial = int.from_bytes(layout.initial[address:address + size], "little", signed=True)
        found = _About(frozenset((initial,)))
        for key in {k for b in range(address, address + size) for k in self.touched.get(b, ())}:
            about = self.places[key]
            if key != (address, size):
                about = _About(None, strange=about.strange | {
                    f"part of {self.names[c]}" for c in about.clocks})
            found = found.joined(about)
        return found


class _ClockWalk(Walk):
    """A walk that follows elapsed times and constants."""

    flow: _ClockFlow
    function: Function

    def through(self, function: Function) -> None:
        self.function = function
        super().through(function)

    # ------------------------------------------------------------ what is wrong, and where

    def here(self, text: str) -> frozenset[str]:
        place = self.function.place(self.at)
        return frozenset((f"{place}: {text}" if place else text,))

    def blame(self, strange: Collection[str]) -> None:
        self.flow.problems.update(dict.fromkeys(sorted(strange)))

    def decide(self, value: Value) -> None:
        """A value decides what is done: it must not be made of elapsed times in a strange way."""
        about = _about(value)
        self.blame(about.strange)
        if about.clocks:
            self.blame(self.here(f"decides by the value of {self.named(about)}"))

    def named(self, about: _About) -> str:
        return ", ".join(self.flow.names[c] for c in sorted(about.clocks))

    # ------------------------------------------------------------ values

    def value(self, op: str) -> None:
        count = len(VALUE_OPS[op].pops)
        operands = [_about(v) for v in self.stack[-count:]]
        super().value(op)
        made = self.combined(op, operands)
        if op.split(".")[0] in MAY_FAULT:
            self.blame(made.strange)
        self.stack[-1] = self.stack[-1]._replace(about=made)

    def combined(self, op: str, operands: list[_About]) -> _About:
        strange = frozenset().union(*(o.strange for o in operands))
        timed = [o for o in operands if o.clocks]
        if not timed:
            return _About(_folded(op, operands), strange=strange)
        name, _, machine = op.partition(".")
        if name in (*_SHIFTS, "eq", "ne") and machine == "i64" and len(timed) == 1:
            first, second = operands
            if second.clocks:
                first, second, name = second, first, _MIRRORED.get(name, name)
            if name in ("eq", "ne"):
                return _About(None, strange=strange | self.here(
                    f"asks whether {self.named(first)} is equal to a value, which it is only for "
                    "an instant; compare with >= or <"))
            if second.numbers is not None:
                for clock in first.clocks:
                    self.flow.thresholds.setdefault(clock, set()).update(
                        n + _SHIFTS[name] for n in second.numbers)
                return _About(frozenset((0, 1)), strange=strange)
            text = f"compares {self.named(first)} with a value that is not constant"
        elif len(timed) == 2 and name in (*_SHIFTS, "eq", "ne"):
            text = f"compares {self.named(operands[0])} with {self.named(operands[1])}"
        else:
            text = f"calculates with {', '.join(map(self.named, timed))}"
        return _About(None, strange=strange | self.here(text))

    def op_const(self, instr: Instr) -> None:
        machine, value = instr.arg
        known = frozenset((int(value),)) if machine not in ("f32", "f64") else None
        self.stack.append(Value(about=_About(known)))

    def op_get(self, instr: Instr) -> None:
        super().op_get(instr)
        value = self.stack[-1]
        self.stack[-1] = value._replace(about=_ZERO if value.about is None
                                        else value.about.joined(_ZERO))

    def op_set(self, instr: Instr) -> None:
        about, before = _about(self.stack[-1]), self.known.get(instr.arg)
        super().op_set(instr)
        if before is not None:
            about = about.joined(_about(before))
        self.known[instr.arg] = self.known[instr.arg]._replace(about=about)

    def op_select(self, instr: Instr) -> None:
        chosen, no, yes = self.stack[-1], self.stack[-2], self.stack[-3]
        about = _about(no).joined(_about(yes))
        super().op_select(instr)
        about = about.joined(_About(strange=_about(chosen).strange))
        self.stack[-1] = self.stack[-1]._replace(about=about)

    def op_ret(self, instr: Instr) -> None:
        about = _about(self.stack[-1]) if self.stack else _ANY
        before = self.flow.results.get(self.key)
        super().op_ret(instr)
        if self.key in self.flow.results:
            about = about.joined(_about(before)) if before is not None else about
            self.flow.results[self.key] = self.flow.results[self.key]._replace(about=about)

    # ------------------------------------------------------------ memory

    def read(self, machine: str, address: int, place: Value = NOTHING) -> None:
        super().read(machine, address, place)
        size = (place.span or 0) + SIZES[machine]
        cells = [c for c in self.flow.cells if c < address + size and address < c + 8]
        if cells == [address] and size == 8:
            about = _About(clocks=frozenset(cells))
        elif place.span:
            stored = self.flow.get(address, size)
            about = _About(None, strange=stored.strange)
        else:
            about = self.flow.get(address, size)
        if cells and cells != [address]:
            about = about.joined(_About(None, strange=self.here(
                f"reads {self.flow.names[cells[0]]} in a way that is not known")))
        self.stack[-1] = self.stack[-1]._replace(about=about)

    def write(self, machine: str, address: int, value: Value, place: Value = NOTHING) -> None:
        super().write(machine, address, value, place)
        about, size = _about(value), SIZES[machine]
        reached = range(address, address + (place.span or 0) + size)
        if not self.flow.kept or not set(reached).isdisjoint(self.flow.kept):
            self.blame(about.strange)
        if place.span:
            about = _About(None, about.clocks, about.strange)
            size = len(reached)
        self.flow.put(address, size, about)
        for cell in self.flow.cells:
            if cell in self.flow.kept and cell < reached.stop and address < cell + 2 * _LIMIT:
                self.check_cell(cell, address, size, about)

    def check_cell(self, cell: int, address: int, size: int, about: _About) -> None:
        """Say what is wrong with what is stored into a clock cell."""
        name = self.flow.names[cell]
        if address == cell and size == 8:
            if about.clocks or about.numbers != frozenset((0,)):
                self.blame(self.here(f"sets {name} to something else than zero"))
        elif address == cell + _LIMIT and size == 8:
            own = not about.clocks or about.clocks == {cell}
            if not own or about.numbers is None:
                self.blame(self.here(f"stops {name} at a value that is not constant"))
        else:
            self.blame(self.here(f"writes over {name} in a way that is not known"))

    def op_copy(self, instr: Instr) -> None:
        target, source = self.stack[-2], self.stack[-1]
        super().op_copy(instr)
        for what, value in (("copies", source), ("writes over", target)):
            start = value.address or 0
            stop = start + (value.span or 0) + instr.arg
            for cell in self.flow.cells:
                if cell in self.flow.kept and cell < stop and start < cell + 2 * _LIMIT:
                    self.blame(self.here(f"{what} {self.flow.names[cell]} with what is around it"))
        self.flow.put(target.address or 0, (target.span or 0) + instr.arg, _ANY)

    # ------------------------------------------------------------ decisions

    def op_index(self, instr: Instr) -> None:
        self.decide(self.stack[-1])
        super().op_index(instr)

    def op_jumpif(self, instr: Instr) -> None:
        self.decide(self.stack[-1])
        super().op_jumpif(instr)

    op_jumpifnot = op_jumpif


def _about(value: Value) -> _About:
    return value.about if value.about is not None else _ANY


def _folded(op: str, operands: list[_About]) -> frozenset[int] | None:
    """Return the values that an operation on known numbers may have."""
    sets = [o.numbers for o in operands]
    many = 1
    for each in sets:
        if each is None:
            return None
        many *= max(1, len(each))
    if many > NUMBERS_KEPT or "f32" in op or "f64" in op:
        return None
    try:
        made = {VALUE_OPS[op].fn(*row) for row in product(*(s or () for s in sets))}
    except (Fault, TypeError):
        return None
    return frozenset(int(value) for value in made)


def lookout(program: Program, kept: Collection[int] | None) -> Lookout:
    """Return what a program can see of the clock cells that matter.

    Args:
        program: the compiled program.
        kept: the bytes of memory that matter (see `plcemu.verify.cone`); None if all do because it
            cannot be told, and then nothing can be told here, either.
    """
    if kept is None:
        return Lookout(problems=(_UNKNOWN,))
    cells = {c.offset: c for c in program.layout.clocks if c.observed}
    flow = _ClockFlow(program, cells=cells, names=clock_names(program), kept=frozenset(kept))
    before = None
    try:
        while flow.places != before:
            before = dict(flow.places)
            flow.problems, flow.locals = {}, {}
            for instance in program.instances:
                follow(flow, program.functions[instance.function], instance.base)
    except Indirect:
        return Lookout(problems=(_UNKNOWN,))
    clocks = []
    for offset in sorted(cells.keys() & flow.kept):
        stops = flow.places.get((offset + _LIMIT, 8), _About()).numbers or frozenset()
        seen = flow.thresholds.get(offset, set()) | stops
        times = tuple(sorted(t for t in seen if 0 < t < _NEVER))
        clocks.append(Clock(flow.names[offset], offset, times))
        if times and times[0] < 2:
            flow.problems[f"{flow.names[offset]} is compared with {times[0] - 1} ns, of which only "
                          "the first instant is told apart; ask for the step's flag instead"] = None
    copies = {b for (at, size), about in flow.places.items() if about.clocks
              for b in range(at, at + size)}
    copies |= {b for c in program.layout.clocks for b in range(c.offset, c.offset + 2 * _LIMIT)}
    return Lookout(tuple(clocks), tuple(flow.problems), frozenset(copies))


def clock_names(program: Program) -> dict[int, str]:
    """Return the clock cells by offset with their names: a step's time, or a timer."""
    named = {slot.offset: slot.tag.name for slot in program.layout.slots}
    found = {}
    for clock in program.layout.clocks:
        name = named.get(clock.offset)
        if name is None and clock.expiry is not None:
            name = named.get(clock.expiry.copy, "").removesuffix(".ET")
        if not name:
            before = [o for o in named if o <= clock.offset]
            name = named[max(before)].removesuffix(".ET") if before else "a timer"
        found[clock.offset] = name
    return found
