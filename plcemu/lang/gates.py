"""EN and ENO of calls (IEC 61131-3, 2.5.1.2 and 2.5.2.1a).

Every function and function block has the input EN and the output ENO without declaring them. While
EN is FALSE the call does nothing: what it would assign stays as it is, and ENO becomes FALSE. A POU
that declares EN or ENO itself has an ordinary variable of that name instead.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from plcemu.lang import syntax as s
from plcemu.lang.types import BlockType

if TYPE_CHECKING:
    from plcemu.lang.lower_st import Statements

Gate = dict[str, s.Argument]
"""The arguments for EN and ENO, by these names."""


def split(arguments: tuple[s.Argument, ...],
          block: BlockType | None) -> tuple[Gate, tuple[s.Argument, ...]]:
    """Return the gate's arguments and the others; `block` is None for a standard function."""
    gate: Gate = {}
    rest = []
    for each in arguments:
        key = each.name.upper()
        implicit = block is None or key not in block.fields
        if implicit and key not in gate and key == ("ENO" if each.is_output else "EN"):
            gate[key] = each
        else:
            rest.append(each)
    return gate, tuple(rest)


@contextmanager
def gated(statements: Statements, gate: Gate) -> Iterator[None]:
    """Put what is lowered inside under the condition EN, and tell ENO behind it."""
    out = statements.out
    skip = out.new_label() if "EN" in gate else None
    if skip is not None:
        statements.condition(gate["EN"].value, skip)
    yield
    eno = gate.get("ENO")
    if eno is not None:
        _tell(statements, eno, True)
    if skip is None:
        return
    if eno is None:
        out.emit("label", skip)
        return
    end = out.new_label()
    out.emit("jump", end, eno.span)
    out.emit("label", skip)
    _tell(statements, eno, False)
    out.emit("label", end)


def _tell(statements: Statements, eno: s.Argument, done: bool) -> None:
    if not isinstance(eno.value, s.Name | s.Direct):
        statements.out.report.error("P0024", eno.value.span, "ENO goes into a variable")
        return
    value = s.Literal(eno.span, "bool", done != eno.negated)
    statements.assign(s.Assign(eno.span, eno.value, value))
