"""CONFIGURATION, RESOURCE and TASK (IEC 61131-3, 2.7)."""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor
from plcemu.lang.st import parse_expression
from plcemu.lang.variables import parse_section

_SECTIONS = ("VAR_GLOBAL", "VAR_ACCESS", "VAR_CONFIG")


def parse_configuration(cursor: Cursor) -> tuple[s.Configuration, list[s.Variable]]:
    """Parse a configuration; return it and the global variables in it."""
    cursor.advance()
    name = cursor.identifier("the configuration's name")
    found: list[s.Variable] = []
    tasks: list[s.TaskDeclaration] = []
    programs: list[s.ProgramInstance] = []
    while not cursor.at("END_CONFIGURATION"):
        if cursor.at(*_SECTIONS):
            found += parse_section(cursor)
        elif cursor.accept("RESOURCE"):
            cursor.identifier("the resource's name")
            cursor.expect("ON", "before the resource's type")
            cursor.identifier("the resource's type")
        elif cursor.accept("END_RESOURCE"):
            cursor.accept(";")
        elif cursor.at("TASK"):
            tasks.append(_task(cursor))
        elif cursor.at("PROGRAM"):
            programs.append(_program(cursor))
        else:
            raise cursor.failure("RESOURCE, TASK, PROGRAM, VAR_GLOBAL or END_CONFIGURATION", "P0011")
    cursor.advance()
    cursor.accept(";")
    return s.Configuration(name.span, name.text, tuple(tasks), tuple(programs)), found


def _task(cursor: Cursor) -> s.TaskDeclaration:
    cursor.advance()
    name = cursor.identifier("the task's name")
    cursor.expect("(", "after the task's name")
    settings = []
    while not cursor.at(")"):
        key = cursor.identifier("INTERVAL, PRIORITY or SINGLE")
        cursor.expect(":=")
        settings.append((key.upper, parse_expression(cursor), key.span))
        if not cursor.accept(","):
            break
    cursor.expect(")", "to close the task", "P0011")
    cursor.expect(";", "after the task")
    return s.TaskDeclaration(name.span, name.text, tuple(settings))


def _program(cursor: Cursor) -> s.ProgramInstance:
    cursor.advance()
    while cursor.at("RETAIN", "NON_RETAIN"):
        cursor.advance()
    name = cursor.identifier("the program instance's name")
    task = cursor.identifier("a task's name").text if cursor.accept("WITH") else ""
    cursor.expect(":", "before the program's type")
    of = cursor.identifier("a PROGRAM")
    if cursor.at("("):
        cursor.report.error("P0090", cursor.token.span,
                            "connections of program instances are not supported yet")
        cursor.skip_to(";")
    cursor.expect(";", "after the program instance")
    return s.ProgramInstance(name.span, name.text, task, of.text, of.span)
