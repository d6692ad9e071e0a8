"""Which reads made a write: the dynamic dependences within one run of a task.

A value that an instruction stores depends on the reads that went into it by way of the stack and of
locals (data dependence), and on the reads of the conditions under which the instruction was
carried out (control dependence). Both are found in one pass over the events of a traced run.

Sources: dynamic slicing, Agrawal and Horgan (PLDI 1990); online control dependence by immediate
postdominators, Xin and Zhang (ISSTA 2007); dominators, Cooper, Harvey and Kennedy (2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plcemu.engine.tracer import Event
from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import VALUE_OPS
from plcemu.ir.program import Function, Instr

READS_KEPT = 400
"""The number of reads that one value is taken to depend on; of more, the latest are kept."""

Reads = frozenset[int]
"""Numbers of events that read memory."""

_NONE: Reads = frozenset()


def _joined(*parts: Reads) -> Reads:
    every = _NONE.union(*parts)
    return every if len(every) <= READS_KEPT else frozenset(sorted(every)[-READS_KEPT:])


@dataclass(slots=True)
class _Activation:
    """A function that runs: what its stack and locals depend on, and under which branches it is."""

    code: Sequence[Instr]
    joins: dict[int, int]
    inherited: Reads
    stack: list[Reads] = field(default_factory=list)
    local: dict[int, Reads] = field(default_factory=dict)
    branches: list[tuple[int, int, Reads]] = field(default_factory=list)

    def pop(self, count: int = 1) -> Reads:
        """Take values off the stack; return what they depend on together."""
        taken = [self.stack.pop() for _ in range(count)]
        return taken[0] if count == 1 else _joined(*taken)

    @property
    def control(self) -> Reads:
        """What it depends on that control is here."""
        return self.branches[-1][2] if self.branches else self.inherited

    def at(self, pc: int) -> None:
        """Leave the branches that come together here."""
        while self.branches and self.branches[-1][1] == pc:
            self.branches.pop()

    def branch(self, pc: int, reads: Reads) -> None:
        """Note that a condition was decided; a loop's next decision takes the place of its last."""
        if self.branches and self.branches[-1][0] == pc:
            self.branches.pop()
        self.branches.append((pc, self.joins[pc], _joined(self.control, reads)))


class Dependences:
    """The dependences of the writes of a scan.

    Args:
        functions: of the program, by name.
    """

    def __init__(self, functions: dict[str, Function]) -> None:
        self._functions = functions
        self._joins: dict[str, dict[int, int]] = {}

    def of(self, events: Sequence[Event]) -> dict[int, Reads]:
        """Return for each event that writes memory the events whose reads it depends on."""
        found: dict[int, Reads] = {}
        frames: list[_Activation] = []
        for n, event in enumerate(events):
            if not frames:
                frames.append(self._enter(event.function, _NONE))
            frame = frames[-1]
            frame.at(event.pc)
            if event.fault:
                continue
            if event.instr.op == "call":
                frame.pop()
                frames.append(self._enter(event.instr.arg, frame.control))
            elif event.instr.op == "ret":
                result = _joined(frame.pop(), frame.control) if frame.stack else None
                frames.pop()
                if frames and result is not None:
                    frames[-1].stack.append(result)
            else:
                uses = _carry_out(frame, n, event)
                if event.writes:
                    found[n] = _joined(uses, frame.control)
        return found

    def _enter(self, name: str, inherited: Reads) -> _Activation:
        function = self._functions[name]
        if name not in self._joins:
            self._joins[name] = joins(function.code)
        return _Activation(function.code, self._joins[name], inherited)


def _carry_out(frame: _Activation, n: int, event: Event) -> Reads:
    """Do to the dependences what an instruction does to the values; return what it consumed."""
    op, arg = event.instr.op, event.instr.arg
    here = frozenset((n,)) if event.reads else _NONE
    if op in ("const", "addr"):
        frame.stack.append(_NONE)
    elif op == "load":
        frame.stack.append(here)
    elif op in ("loadat", "index"):
        frame.stack.append(_joined(frame.pop(), here))
    elif op in ("store", "drop"):
        return frame.pop()
    elif op == "storeat":
        return frame.pop(2)
    elif op == "copy":
        return _joined(frame.pop(2), here)
    elif op == "select":
        frame.stack.append(frame.pop(3))
    elif op == "get":
        frame.stack.append(frame.local.get(arg, _NONE))
    elif op == "set":
        frame.local[arg] = _joined(frame.pop(), frame.control)
    elif op in ("jumpif", "jumpifnot"):
        frame.branch(event.pc, frame.pop())
    elif op == "builtin":
        row = BUILTINS[arg]
        uses = _joined(frame.pop(len(row.pops)), here)
        if not row.pushes:
            return uses
        frame.stack.append(uses)
    elif op in VALUE_OPS:
        frame.stack.append(frame.pop(len(VALUE_OPS[op].pops)))
    return _NONE


# ---------------------------------------------------------------- where branches come together


def joins(code: Sequence[Instr]) -> dict[int, int]:
    """Return for each conditional jump the instruction where its two ways first come together.

    That is its immediate postdominator; the number behind the last instruction is the end.
    """
    end = len(code)
    ways = _ways(code)
    before: list[list[int]] = [[] for _ in range(end + 1)]
    for pc, targets in enumerate(ways):
        for target in targets:
            before[target].append(pc)
    order = _from_the_end(before, end)
    rank = {pc: n for n, pc in enumerate(order)}
    nearest: dict[int, int] = {end: end}

    def common(a: int, b: int) -> int:
        while a != b:
            while rank[a] > rank[b]:
                a = nearest[a]
            while rank[b] > rank[a]:
                b = nearest[b]
        return a

    changed = True
    while changed:
        changed = False
        for pc in order[1:]:
            known = [t for t in ways[pc] if t in nearest]
            joint = known[0]
            for target in known[1:]:
                joint = common(joint, target)
            if nearest.get(pc) != joint:
                nearest[pc], changed = joint, True
    return {pc: nearest.get(pc, end) for pc, instr in enumerate(code)
            if instr.op in ("jumpif", "jumpifnot")}


def _ways(code: Sequence[Instr]) -> list[tuple[int, ...]]:
    """Return what may follow each instruction."""
    labels = {instr.arg: pc for pc, instr in enumerate(code) if instr.op == "label"}
    ways: list[tuple[int, ...]] = []
    for pc, instr in enumerate(code):
        if instr.op in ("ret", "fault"):
            ways.append((len(code),))
        elif instr.op == "jump":
            ways.append((labels[instr.arg],))
        elif instr.op in ("jumpif", "jumpifnot"):
            ways.append((pc + 1, labels[instr.arg]))
        else:
            ways.append((pc + 1,))
    return ways


def _from_the_end(before: list[list[int]], end: int) -> list[int]:
    """Return the instructions in reverse postorder of the ways back from the end."""
    seen, order = {end}, []
    stack = [(end, iter(before[end]))]
    while stack:
        pc, rest = stack[-1]
        following = next((p for p in rest if p not in seen), None)
        if following is None:
            order.append(pc)
            stack.pop()
        else:
            seen.add(following)
            stack.append((following, iter(before[following])))
    return order[::-1]
