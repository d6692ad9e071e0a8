"""The flow of control in an IL body: its blocks, and where the current result is still wanted."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from plcemu.lang import syntax as s


def is_jump(instruction: s.Instruction) -> bool:
    """Whether nothing passes from this instruction to the next one."""
    return instruction.op in ("JMP", "RET") and not instruction.conditional


def find_labels(instructions: Sequence[s.Instruction]) -> dict[str, int]:
    """Return the labels, in capitals, with the instructions that they stand before."""
    labels: dict[str, int] = {}
    for n, each in enumerate(instructions):
        if each.label:
            labels.setdefault(each.label.upper(), n)
    return labels


def find_blocks(instructions: Sequence[s.Instruction]) -> list[tuple[int, int]]:
    """Return the stretches [begin, end) that are entered only at their begin, in order."""
    begins = {0} | {n for n, each in enumerate(instructions) if each.label} \
        | {n + 1 for n, each in enumerate(instructions) if is_jump(each)}
    edges = [*sorted(n for n in begins if n < len(instructions)), len(instructions)]
    return list(pairwise(edges)) or [(0, 0)]


def find_wanted(instructions: Sequence[s.Instruction], labels: dict[str, int],
                at_end: bool) -> list[bool]:
    """Return for each instruction whether it, or what follows, takes the current result.

    One more value is for the end of the body; `at_end` tells whether the result is wanted there,
    and where the body returns.
    """
    end = len(instructions)
    wanted: list[bool | None] = [*(None for _ in instructions), at_end]
    for start in reversed(range(end)):
        path, n = [], start
        while wanted[n] is None:
            path.append(n)
            wanted[n] = _takes(instructions[n], at_end)
            if wanted[n] is None:
                wanted[n] = False  # a way round in circles never takes it
                n = _next(instructions[n], n, labels, end)
        for passed in path:
            wanted[passed] = wanted[n]
    return [bool(each) for each in wanted]


def _takes(each: s.Instruction, at_end: bool) -> bool | None:
    """Whether an instruction takes the current result; None if it leaves it to what follows."""
    if not each.op or (each.op in ("CAL", "JMP") and not each.conditional):
        return None
    if each.op == "RET" and not each.conditional:
        return at_end
    return each.op not in ("LD", "FUNCTION(")


def _next(each: s.Instruction, n: int, labels: dict[str, int], end: int) -> int:
    if each.op == "JMP" and isinstance(each.operand, s.Name):
        return labels.get(each.operand.head.upper(), end)
    return n + 1
