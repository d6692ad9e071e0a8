"""The IR's text form: what `plcemu check --dump ir` prints and what reads back to the same code."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator

from plcemu.base.errors import PlcemuError
from plcemu.ir.ops import BASES, MACHINE_TYPES, STRUCTURAL, VALUE_OPS
from plcemu.ir.program import Function, Instr, Program

_HEAD = re.compile(r"function (?P<name>\S+) \((?P<locals>[^()]*)\) -> "
                   r"(?P<result>\S+) of (?P<pou>\S+)")


class IrTextError(PlcemuError):
    """A text is not IR: the line, what was found and what was expected."""


def print_program(program: Program) -> str:
    """Return the whole program as text: memory, instances, tasks, functions."""
    lines = [f"; memory {program.layout.size} bytes"]
    lines += [f"; extent {e.area} {e.first} +{e.count} at {e.offset}"
              for e in program.layout.extents]
    lines += [f"; clock at {c.offset}{' observed' if c.observed else ''}"
              f"{f' copied to {c.expiry.copy}' if c.expiry else ''}"
              for c in program.layout.clocks]
    lines += [f"; tag {s.tag.name} {s.tag.type} at {s.offset} {s.tag.address}".rstrip()
              for s in program.layout.slots]
    lines += [f"; instance {i.name} runs {i.function} at {i.base}" for i in program.instances]
    lines += [f"; task {t.name} interval {t.interval_ns} priority {t.priority} phase {t.phase_ns}: "
              f"{' '.join(t.programs)}" for t in program.tasks]
    return "\n".join(lines + [print_function(f) for f in program.functions.values()]) + "\n"


def digest(program: Program) -> str:
    """Return a fingerprint of code, layout and initial values, equal for equal programs."""
    return hashlib.sha256(print_program(program).encode() + program.layout.initial).hexdigest()[:16]


def print_function(function: Function) -> str:
    """Return one function as text; a comment names the source line where it changes."""
    head = f"\nfunction {function.name} ({' '.join(function.locals)}) -> {function.result or '-'}"
    lines, place = [head + f" of {function.pou or '-'}"], ""
    for instr in function.code:
        text = _instruction(instr)
        here = str(instr.span).rsplit(":", 1)[0] if instr.span else place
        comment = f"{'':<{max(1, 36 - len(text))}}; {here}" if here != place else ""
        place = here
        lines.append(text + comment)
    return "\n".join([*lines, "end"])


def _instruction(instr: Instr) -> str:
    op, arg = instr.op, instr.arg
    if op == "label":
        return f"L{arg}:"
    if op in ("jump", "jumpif", "jumpifnot"):
        return f"  {op} L{arg}"
    if op in ("load", "store"):
        return f"  {op}.{arg[0]} {arg[1]}+{arg[2]}"
    if op == "addr":
        return f"  addr {arg[0]}+{arg[1]}"
    if op == "const":
        return f"  const.{arg[0]} {arg[1]!r}"
    if op in ("loadat", "storeat"):
        return f"  {op}.{arg[0]} +{arg[1]}"
    if op == "index":
        return f"  index {arg[0]} {arg[1]} {arg[2]}"
    if op == "fault":
        return f"  fault {json.dumps(arg)}"
    return f"  {op}" if arg is None else f"  {op} {arg}"


def parse_functions(text: str) -> dict[str, Function]:
    """Read the functions of a text that `print_program` or `print_function` wrote.

    Raises:
        IrTextError: a line is malformed.
    """
    functions: dict[str, Function] = {}
    lines = _meaningful(text)
    for number, line in lines:
        head = _HEAD.fullmatch(line)
        if head is None:
            raise IrTextError(f"line {number}: expected a function, found {line!r}")
        code = []
        for inner, body in lines:
            if body == "end":
                break
            code.append(_read(inner, body))
        else:
            raise IrTextError(f"line {number}: function {head['name']} has no end")
        functions[head["name"]] = Function(head["name"], tuple(code), tuple(head["locals"].split()),
                                           head["result"].strip("-"), head["pou"].strip("-"))
    return functions


def _meaningful(text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip() if " fault " in f" {line} " else line.split(";")[0].strip()
        if stripped and not stripped.startswith(";"):
            yield number, stripped


def _read(number: int, line: str) -> Instr:
    try:
        return _read_instruction(line)
    except (ValueError, IndexError):
        raise IrTextError(f"line {number}: not an instruction: {line!r}") from None


def _read_instruction(line: str) -> Instr:
    if line.startswith("L") and line.endswith(":"):
        return Instr("label", int(line[1:-1]))
    op, _, rest = line.partition(" ")
    rest = rest.strip()
    if op in VALUE_OPS:
        return Instr(op)
    if op in ("jump", "jumpif", "jumpifnot"):
        return Instr(op, int(rest[1:]))
    if op in ("get", "set", "copy"):
        return Instr(op, int(rest))
    if op == "index":
        low, count, size = map(int, rest.split())
        return Instr(op, (low, count, size))
    if op == "fault":
        return Instr(op, json.JSONDecoder().raw_decode(rest)[0])
    if op == "addr":
        return Instr(op, _place(rest))
    head, _, machine = op.partition(".")
    if head in ("load", "store"):
        return Instr(head, (_machine(machine), *_place(rest)))
    if head in ("loadat", "storeat"):
        return Instr(head, (_machine(machine), int(rest)))
    if head == "const":
        value = float(rest) if machine in ("f32", "f64") else rest == "True" \
            if rest in ("True", "False") else int(rest)
        return Instr(head, (_machine(machine), value))
    if op not in STRUCTURAL:
        raise ValueError(op)
    return Instr(op, rest or None)


def _machine(text: str) -> str:
    return MACHINE_TYPES[MACHINE_TYPES.index(text)]


def _place(text: str) -> tuple[str, int]:
    base, _, offset = text.partition("+")
    return BASES[BASES.index(base)], int(offset)
