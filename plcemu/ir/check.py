"""The rules every function keeps: what an engine may rely on without asking.

The stack holds what each instruction expects, is empty at labels and where a jump goes, and holds
just the result at `ret`.
"""

from __future__ import annotations

from plcemu.ir.ops import VALUE_OPS
from plcemu.ir.program import Function, Instr


class IrInvalid(AssertionError):
    """The front end made wrong code; a defect of this program, not of the user's."""


def check_function(function: Function, functions: dict[str, Function]) -> None:
    """Check one function against the rules.

    Raises:
        IrInvalid: with the place.
    """
    labels = [i.arg for i in function.code if i.op == "label"]
    if len(labels) != len(set(labels)):
        raise IrInvalid(f"{function.name}: a label stands twice")
    stack: list[str] | None = []
    for n, instr in enumerate(function.code):
        if stack is None and instr.op != "label":
            continue
        try:
            stack = _step(instr, stack or [], function, functions, labels)
        except (IrInvalid, IndexError) as problem:
            raise IrInvalid(f"{function.name}[{n}] {instr.op} {instr.arg}: {problem}") from None
    if stack is not None:
        raise IrInvalid(f"{function.name}: runs off its end")


def _step(instr: Instr, stack: list[str], function: Function, functions: dict[str, Function],
          labels: list[int]) -> list[str] | None:
    op, arg = instr.op, instr.arg
    if op in VALUE_OPS:
        row = VALUE_OPS[op]
        for machine in reversed(row.pops):
            _pop(stack, machine)
        stack.append(row.pushes)
    elif op in ("const", "load"):
        stack.append(arg[0])
    elif op == "store":
        _pop(stack, arg[0])
    elif op == "addr":
        stack.append("u32")
    elif op == "get":
        stack.append(function.locals[arg])
    elif op == "set":
        _pop(stack, function.locals[arg])
    elif op == "drop":
        stack.pop()
    elif op == "call":
        _pop(stack, "u32")
        stack += [functions[arg].result] if functions[arg].result else []
    else:
        return _flow(op, arg, stack, function, labels)
    return stack


def _flow(op: str, arg: object, stack: list[str], function: Function,
          labels: list[int]) -> list[str] | None:
    if op in ("jumpif", "jumpifnot"):
        _pop(stack, "bool")
    if op in ("jump", "jumpif", "jumpifnot") and arg not in labels:
        raise IrInvalid("there is no such label")
    if op == "ret":
        if stack != ([function.result] if function.result else []):
            raise IrInvalid(f"returns {stack}, declared {function.result!r}")
        return None
    if op == "fault":
        return None
    if stack:
        raise IrInvalid(f"the stack holds {stack}")
    return None if op == "jump" else stack


def _pop(stack: list[str], machine: str) -> None:
    found = stack.pop()
    if found != machine:
        raise IrInvalid(f"expected {machine} on the stack, found {found}")
