"""The meaning of Instruction List, written from the standard's text and used as an oracle.

An evaluation result is kept in one accumulator (IEC 61131-3, 3.2.2). An instruction is
(operator, negated, operand, target): the operand is a variable's name or, for a deferred
operator, a list of instructions; the target is the index a jump goes to.
"""

from __future__ import annotations

from dataclasses import dataclass

LOGIC = {"AND": lambda a, b: a and b, "OR": lambda a, b: a or b, "XOR": lambda a, b: a != b}


@dataclass(frozen=True)
class Line:
    """One instruction."""

    op: str
    negated: bool = False
    operand: str | tuple[Line, ...] = ""
    target: int = -1


def run(lines: tuple[Line, ...], variables: dict[str, bool]) -> None:
    """Execute a body of Boolean instructions."""
    _execute(lines, variables, False)


def _execute(lines: tuple[Line, ...], variables: dict[str, bool], result: bool) -> bool:
    at = 0
    while at < len(lines):
        line = lines[at]
        at += 1
        if line.op in LOGIC:
            inner = line.operand
            value = variables[inner] if isinstance(inner, str) else \
                _execute(inner, variables, False)
            result = LOGIC[line.op](result, not value if line.negated else value)
        elif line.op == "LD":
            result = variables[str(line.operand)] != line.negated
        elif line.op == "ST":
            variables[str(line.operand)] = result != line.negated
        elif line.op in ("S", "R"):
            variables[str(line.operand)] = line.op == "S" if result else \
                variables[str(line.operand)]
        elif line.op == "NOT":
            result = not result
        elif line.op == "JMP" or (line.op == "JMPC" and result != line.negated):
            at = line.target
        elif line.op == "RETC" and result != line.negated:
            return result
    return result


def text(lines: tuple[Line, ...]) -> str:
    """Return the body as text."""
    targets = {line.target for line in lines}
    rows = []
    for n, line in enumerate(lines):
        rows += [f"l{n}:"] * (n in targets) + _rows(line)
    return "\n".join(rows + [f"l{len(lines)}:"] * (len(lines) in targets))


def _rows(line: Line) -> list[str]:
    op = line.op + "N" * line.negated
    if line.target >= 0:
        return [f"{op} l{line.target}"]
    if isinstance(line.operand, str):
        return [f"{op} {line.operand}".rstrip()]
    first, *rest = line.operand
    opening = [f"{op}( {first.operand}"] if not first.negated else [f"{op}(", *_rows(first)]
    return [*opening, *(row for inner in rest for row in _rows(inner)), ")"]
