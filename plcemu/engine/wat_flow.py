"""Structured control flow from labels and jumps.

WebAssembly jumps only out of a block, forwards, or to the head of a loop around it. The stack is
empty at labels, so blocks and loops can begin and end anywhere between statements: a label that is
jumped to from before is the end of a block, one that is jumped to from behind the head of a loop.
A jump from outside into a loop has no such form; a function with one is run by a dispatcher.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plcemu.ir.program import Instr

JUMPS = ("jump", "jumpif", "jumpifnot")


@dataclass(slots=True)
class Loop:
    """A label that is jumped to from behind: from its place to the last such jump."""

    label: int
    start: int
    end: int
    outer: Loop | None = None


@dataclass(slots=True)
class Flow:
    """Where blocks and loops begin and end, by instruction.

    Attributes:
        live: whether each instruction can be reached at all.
        places: where each label is.
        opens: before an instruction: labels whose blocks begin there, the outermost first.
        loops: at a label: whether a loop begins there (inside the blocks that begin there).
        closes: after an instruction: how many loops end there.
        targets: labels that are jumped to from before.
        dispatched: labels that are jumped to from behind, if a dispatcher must do it; else empty.
    """

    live: list[bool]
    places: dict[int, int]
    opens: dict[int, list[int]] = field(default_factory=dict)
    loops: set[int] = field(default_factory=set)
    closes: dict[int, int] = field(default_factory=dict)
    targets: set[int] = field(default_factory=set)
    dispatched: list[int] = field(default_factory=list)


def flow_of(code: Sequence[Instr]) -> Flow:
    """Find the structure of a function's code."""
    live = _live(code)
    places = {i.arg: n for n, i in enumerate(code) if i.op == "label"}
    first: dict[int, int] = {}
    last: dict[int, int] = {}
    for n, instr in enumerate(code):
        if live[n] and instr.op in JUMPS:
            if places[instr.arg] > n:
                first.setdefault(instr.arg, n)
            else:
                last[instr.arg] = n
    flow = Flow(live, places, targets=set(first))
    loops = _loops(places, last)
    inside = _nest(loops, len(code))
    blocks = []
    for label, start in first.items():
        lifted = _lift(start, places[label], inside)
        if lifted is None:
            flow.dispatched = sorted(last, key=places.__getitem__)
            flow.targets |= set(last)
            return flow
        blocks.append((places[label], lifted, label))
    for start, label in _disjoint_or_nested(blocks):
        flow.opens.setdefault(start, []).insert(0, label)
    for loop in loops:
        flow.loops.add(loop.label)
        flow.closes[loop.end] = flow.closes.get(loop.end, 0) + 1
    return flow


def _live(code: Sequence[Instr]) -> list[bool]:
    live, alive = [], True
    for instr in code:
        alive = alive or instr.op == "label"
        live.append(alive)
        alive = alive and instr.op not in ("jump", "ret", "fault")
    return live


def _loops(places: dict[int, int], last: dict[int, int]) -> list[Loop]:
    """Return the loops by their starts; those that overlap are stretched until they nest."""
    loops = sorted((Loop(label, places[label], end) for label, end in last.items()),
                   key=lambda loop: loop.start)
    around: list[Loop] = []
    for loop in loops:
        while around and around[-1].end < loop.start:
            around.pop()
        loop.outer = around[-1] if around else None
        for outer in around:
            outer.end = max(outer.end, loop.end)
        around.append(loop)
    return loops


def _nest(loops: list[Loop], count: int) -> list[Loop | None]:
    """Return the innermost loop around each instruction; its own label is outside."""
    inside: list[Loop | None] = [None] * count
    for loop in loops:
        inside[loop.start + 1:loop.end + 1] = [loop] * (loop.end - loop.start)
    return inside


def _lift(start: int, end: int, inside: list[Loop | None]) -> int | None:
    """Return where a block may begin; None if it would end in a loop that it is outside of."""
    loop = inside[start]
    while loop and loop.end < end:
        start, loop = loop.start, loop.outer
    return start if loop is inside[end] else None


def _disjoint_or_nested(blocks: list[tuple[int, int, int]]) -> list[tuple[int, int]]:
    """Return starts and labels of blocks (end, start, label), the inner before the outer."""
    nested: list[tuple[int, int]] = []
    ended: list[tuple[int, int]] = []
    for end, start, label in sorted(blocks):
        while ended and ended[-1][0] > start:
            start = min(start, ended.pop()[1])
        ended.append((end, start))
        nested.append((start, label))
    return nested
