"""The rules every function keeps: what an engine may rely on without asking.

The stack holds what each instruction expects, is empty at labels and where a jump goes, and holds
just the result at `ret`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from plcemu.ir.builtins import BUILTINS
from plcemu.ir.ops import BASES, MACHINE_TYPES, STRUCTURAL, VALUE_OPS, is_value
from plcemu.ir.program import Function, Instr


class IrInvalid(AssertionError):
    """The front end made wrong code; a defect of this program, not of the user's."""


def check_function(function: Function, functions: dict[str, Function]) -> None:
    """Check one function against the rules.

    Raises:
        IrInvalid: with the place.
    """
    stood = [i.arg for i in function.code if i.op == "label"]
    labels = set(stood)
    if len(labels) != len(stood):
        raise IrInvalid(f"{function.name}: a label stands twice")
    stack: list[str] | None = []
    for n, instr in enumerate(function.code):
        if stack is None and instr.op != "label":
            continue
        try:
            stack = _step(instr, stack or [], function, functions, labels)
        except (IrInvalid, IndexError, KeyError, TypeError, ValueError) as problem:
            raise IrInvalid(f"{function.name}[{n}] {instr.op} {instr.arg}: {problem}") from None
    if stack is not None:
        raise IrInvalid(f"{function.name}: runs off its end")


def _step(instr: Instr, stack: list[str], function: Function, functions: dict[str, Function],
          labels: set[int]) -> list[str] | None:
    op, arg = instr.op, instr.arg
    if op in VALUE_OPS:
        row = VALUE_OPS[op]
        for machine in reversed(row.pops):
            _pop(stack, machine)
        stack.append(row.pushes)
    elif op == "const":
        if not is_value(arg[1], arg[0]):
            raise IrInvalid("no value of that machine type")
        stack.append(arg[0])
    elif op in ("load", "store"):
        machine, base, offset = arg
        _check_place(base, offset)
        if op == "store":
            _pop(stack, machine)
        else:
            stack.append(MACHINE_TYPES[MACHINE_TYPES.index(machine)])
    elif op == "addr":
        _check_place(*arg)
        stack.append("u32")
    elif op == "get":
        stack.append(function.locals[arg])
    elif op == "set":
        _pop(stack, function.locals[arg])
    elif op == "drop":
        stack.pop()
    elif op in _BY_ADDRESS:
        _BY_ADDRESS[op](arg, stack)
    elif op == "call":
        _pop(stack, "u32")
        stack += [functions[arg].result] if functions[arg].result else []
    else:
        return _flow(op, arg, stack, function, labels)
    return stack


def _check_place(base: str, offset: int) -> None:
    if base not in BASES or offset < 0:
        raise IrInvalid("no place in memory")


def _loadat(arg: tuple[str, int], stack: list[str]) -> None:
    _pop(stack, "u32")
    stack.append(arg[0])


def _storeat(arg: tuple[str, int], stack: list[str]) -> None:
    _pop(stack, arg[0])
    _pop(stack, "u32")


def _copy(arg: int, stack: list[str]) -> None:
    _pop(stack, "u32")
    _pop(stack, "u32")


def _index(arg: tuple[int, int, int], stack: list[str]) -> None:
    _pop(stack, "i64")
    stack.append("u32")


def _select(arg: str, stack: list[str]) -> None:
    for machine in ("bool", arg, arg):
        _pop(stack, machine)
    stack.append(arg)


def _builtin(arg: str, stack: list[str]) -> None:
    row = BUILTINS[arg]
    for machine in reversed(row.pops):
        _pop(stack, machine)
    if row.pushes:
        stack.append(row.pushes)


_BY_ADDRESS: dict[str, Callable[[Any, list[str]], None]] = {
    "loadat": _loadat, "storeat": _storeat, "copy": _copy, "index": _index, "select": _select,
    "builtin": _builtin}


def _flow(op: str, arg: object, stack: list[str], function: Function,
          labels: set[int]) -> list[str] | None:
    if op in ("jumpif", "jumpifnot"):
        _pop(stack, "bool")
    elif op not in STRUCTURAL:
        raise IrInvalid("there is no such operation")
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
    if not stack:
        raise IrInvalid(f"expected {machine} on the stack, which is empty")
    found = stack.pop()
    if found != machine:
        raise IrInvalid(f"expected {machine} on the stack, found {found}")
