"""Connections of program instances with global variables and addresses (IEC 61131-3, 2.7.1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from plcemu.base.areas import Address
from plcemu.base.errors import did_you_mean
from plcemu.ir.program import Function
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
from plcemu.lang.frames import Functions
from plcemu.lang.lower_st import Statements
from plcemu.lang.planning import Planned, without_resource
from plcemu.lang.report import Report
from plcemu.lang.scope import Scope

_SECTIONS = {False: "VAR_INPUT", True: "VAR_OUTPUT"}
"""What a connection may name: `:=` gives to an input, `=>` takes from an output."""


def connected(planned: Planned, resources: set[str], globals_: Scope,
              offset: Callable[[Address], int], plan: Functions,
              report: Report) -> tuple[Function, Scope] | None:
    """Return what runs an instance between its connections; None if it has none.

    Inputs take their values before the program runs, outputs go on after it. The scope knows
    what the connections write.
    """
    declaration = planned.declaration
    if declaration is None or not declaration.connections:
        return None
    program = planned.scope.pou.name.upper()
    pou = replace(planned.scope.pou, name=f"{planned.name}:{program}")
    own = {f"__OWN_{key}": place for key, place in planned.scope.places.items()}
    scope = Scope(pou, planned.scope.type, planned.scope.members, globals_, own)
    out = Emitter(scope, offset, report, pou.name.upper(), "", plan)
    statements = Statements(out)
    before, after = [], []
    for each in declaration.connections:
        if _is_known(each, planned.scope, report):
            own_name = s.Name(each.name_span, (f"__own_{each.name}",))
            other = without_resource(each.other, globals_, resources) \
                if isinstance(each.other, s.Name | s.Direct) else each.other
            if not each.is_output:
                before.append(s.Assign(each.name_span, own_name, other))
            elif isinstance(other, s.Name | s.Direct):
                after.append(s.Assign(each.name_span, other, own_name))
            else:
                report.error("P0024", other.span, "an output goes into a variable")
    run = s.RunAction(declaration.span, program)
    statements.lower((*before, run, *after))
    out.emit("ret", None, declaration.span)
    return out.function(), scope


def _is_known(connection: s.Connection, scope: Scope, report: Report) -> bool:
    """Whether a program has what a connection names; a mistake goes to the report."""
    section = _SECTIONS[connection.is_output]
    field = scope.type.fields.get(connection.name.upper())
    if field is not None and field.section == section:
        return True
    known = [f.name for f in scope.type.fields.values() if f.section == section]
    what = "output" if connection.is_output else "input"
    report.error("P0026", connection.name_span,
                 f"{scope.pou.name} has no {what} {connection.name!r}",
                 did_you_mean(connection.name, known).removeprefix("; "))
    return False
