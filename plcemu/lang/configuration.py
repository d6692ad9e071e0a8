"""CONFIGURATION, RESOURCE and TASK (IEC 61131-3, 2.7)."""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor
from plcemu.lang.lexer import Token
from plcemu.lang.st import parse_expression
from plcemu.lang.variables import parse_section

_SECTIONS = ("VAR_GLOBAL", "VAR_ACCESS")


def parse_configuration(cursor: Cursor) -> tuple[s.Configuration, list[s.Variable]]:
    """Parse a configuration; return it and the global variables in it."""
    cursor.advance()
    name = cursor.identifier("the configuration's name")
    found: list[s.Variable] = []
    resources: list[Token] = []
    resource = ""
    tasks: list[s.TaskDeclaration] = []
    programs: list[s.ProgramInstance] = []
    while not cursor.at("END_CONFIGURATION"):
        if cursor.at("VAR_CONFIG"):
            _skip_instance_values(cursor)
        elif cursor.at(*_SECTIONS):
            found += parse_section(cursor)
        elif cursor.accept("RESOURCE"):
            resources.append(cursor.identifier("the resource's name"))
            resource = resources[-1].text
            cursor.expect("ON", "before the resource's type")
            cursor.identifier("the resource's type")
        elif cursor.accept("END_RESOURCE"):
            cursor.accept(";")
            resource = ""
        elif cursor.at("TASK"):
            tasks.append(_task(cursor, resource))
        elif cursor.at("PROGRAM"):
            programs.append(_program(cursor, resource))
        else:
            raise cursor.failure("RESOURCE, TASK, PROGRAM, VAR_GLOBAL or END_CONFIGURATION",
                                 "P0011")
    cursor.advance()
    cursor.accept(";")
    made = s.Configuration(name.span, name.text, tuple(tasks), tuple(programs),
                           tuple(r.span for r in resources), tuple(r.text for r in resources))
    return made, found


def _skip_instance_values(cursor: Cursor) -> None:
    cursor.report.error("P0090", cursor.token.span, "VAR_CONFIG is not supported yet; write "
                        "addresses and initial values where the variables are declared")
    cursor.skip_to("END_VAR", over=("END_VAR",))
    cursor.accept(";")


def _task(cursor: Cursor, resource: str) -> s.TaskDeclaration:
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
    return s.TaskDeclaration(name.span, name.text, tuple(settings), resource)


def _program(cursor: Cursor, resource: str) -> s.ProgramInstance:
    cursor.advance()
    retain = cursor.accept("RETAIN") is not None
    cursor.accept("NON_RETAIN")
    name = cursor.identifier("the program instance's name")
    task = cursor.identifier("a task's name").text if cursor.accept("WITH") else ""
    cursor.expect(":", "before the program's type")
    of = cursor.identifier("a PROGRAM")
    connections = _connections(cursor) if cursor.accept("(") else []
    cursor.expect(";", "after the program instance")
    return s.ProgramInstance(name.span, name.text, task, of.text, of.span,
                             tuple(connections), resource, retain)


def _connections(cursor: Cursor) -> list[s.Connection]:
    """Parse what stands in a program instance's parentheses (prog_conf_elements, annex B.1.7)."""
    found: list[s.Connection] = []
    while not cursor.at(")"):
        name = cursor.identifier("an input, an output or a function block instance")
        if cursor.accept("WITH"):
            cursor.identifier("a task's name")
            cursor.report.warning("P0090", name.span, "tasks of function block instances are not "
                                  f"supported yet: {name.text} runs where its program calls it")
        else:
            is_output = cursor.accept("=>") is not None
            if not is_output:
                cursor.expect(":=", "or '=>' after the variable's name")
            found.append(s.Connection(name.span, name.text, parse_expression(cursor), is_output))
        if not cursor.accept(","):
            break
    cursor.expect(")", "to close the connections", "P0011")
    return found
