"""Sequential Function Chart as text (IEC 61131-3, 2.6)."""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor, SyntaxFailure
from plcemu.lang.il import looks_like_il, parse_il
from plcemu.lang.st import parse_expression, parse_statements

ELEMENTS = ("INITIAL_STEP", "STEP", "TRANSITION", "ACTION")

QUALIFIERS = {"N": False, "R": False, "S": False, "L": True, "D": True, "P": False, "SD": True,
              "DS": True, "SL": True, "P0": False, "P1": False}
"""The action qualifiers (table 45): whether a time belongs to it."""


def parse_sfc(cursor: Cursor) -> s.SfcBody:
    """Parse steps, transitions and actions in any order, up to the end of the POU."""
    start = cursor.place()
    steps: list[s.Step] = []
    transitions: list[s.Transition] = []
    actions: list[s.Action] = []
    while cursor.at(*ELEMENTS):
        keyword = cursor.token.upper
        try:
            if keyword == "TRANSITION":
                transitions.append(_transition(cursor))
            elif keyword == "ACTION":
                actions.append(_action(cursor))
            else:
                steps.append(_step(cursor))
        except SyntaxFailure:
            cursor.skip_to(*ELEMENTS, "END_STEP", "END_TRANSITION", "END_ACTION", "END_PROGRAM",
                           "END_FUNCTION_BLOCK",
                           over=("END_STEP", "END_TRANSITION", "END_ACTION"))
    return s.SfcBody(start.to(cursor.place()), tuple(steps), tuple(transitions), tuple(actions))


def _step(cursor: Cursor) -> s.Step:
    initial = cursor.advance().upper == "INITIAL_STEP"
    name = cursor.identifier("the step's name")
    cursor.expect(":", "after the step's name")
    associations: list[s.Association] = []
    cursor.mend_closer()
    while not cursor.at("END_STEP"):
        associations.append(_association(cursor))
        cursor.expect(";", "after the action block")
        cursor.mend_closer()
    cursor.expect("END_STEP", code="P0011")
    cursor.accept(";")
    return s.Step(name.span, name.text, initial, tuple(associations))


def _association(cursor: Cursor) -> s.Association:
    name = cursor.identifier("an action block or END_STEP")
    qualifier, time = "N", None
    if cursor.accept("("):
        if not cursor.at(")"):
            qualifier, time = _qualifier(cursor)
        while cursor.accept(","):
            indicator = cursor.identifier("an indicator variable")
            cursor.report.error("P0090", indicator.span,
                                "indicator variables of action blocks are not supported yet")
        cursor.expect(")", "to close the action block", "P0011")
    return s.Association(name.span, name.text, qualifier, time)


def _qualifier(cursor: Cursor) -> tuple[str, s.Expr | None]:
    token = cursor.advance()
    if token.upper not in QUALIFIERS:
        cursor.report.error("P0052", token.span, f"{token.text!r} is not an action qualifier; "
                            f"there are {' '.join(QUALIFIERS)}")
        cursor.skip_to(")", ";", "END_STEP")
        return "N", None
    time = parse_expression(cursor) if cursor.accept(",") else None
    timed = QUALIFIERS[token.upper]
    if timed and time is None:
        cursor.report.error("P0053", token.span, f"qualifier {token.text} needs a time, such as "
                            f"({token.text}, T#5s)")
    elif not timed and time is not None:
        cursor.report.error("P0053", time.span, f"qualifier {token.text} takes no time")
        time = None
    return token.upper, time


def _transition(cursor: Cursor) -> s.Transition:
    start, name, priority = cursor.advance().span, "", None
    if not cursor.at("FROM", "("):
        name = cursor.identifier("FROM or the transition's name").text
    if cursor.accept("("):
        cursor.expect("PRIORITY")
        cursor.expect(":=", "after PRIORITY")
        if cursor.token.kind != "int":
            raise cursor.failure("a whole number as priority")
        priority = int(cursor.advance().value)
        cursor.expect(")", "after the priority", "P0011")
    cursor.expect("FROM")
    sources = _step_names(cursor)
    cursor.expect("TO")
    targets = _step_names(cursor)
    span = start.to(cursor.previous.span)
    condition: s.Expr | s.IlBody
    if cursor.accept(":="):
        condition = parse_expression(cursor)
        cursor.expect(";", "after the condition")
    else:
        cursor.expect(":", "or ':=' before the transition's condition")
        condition = parse_il(cursor)
    cursor.expect("END_TRANSITION", code="P0011")
    cursor.accept(";")
    return s.Transition(span, name, priority, sources, targets, condition)


def _step_names(cursor: Cursor) -> tuple[s.Name, ...]:
    def one() -> s.Name:
        token = cursor.identifier("a step's name")
        return s.Name(token.span, (token.text,))

    if not cursor.accept("("):
        return (one(),)
    names = [one()]
    while cursor.accept(","):
        names.append(one())
    cursor.expect(")", "after the steps' names", "P0011")
    return tuple(names)


def _action(cursor: Cursor) -> s.Action:
    cursor.advance()
    name = cursor.identifier("the action's name")
    cursor.expect(":", "after the action's name")
    body: s.IlBody | s.StBody
    if looks_like_il(cursor):
        body = parse_il(cursor)
    else:
        start = cursor.place()
        statements = parse_statements(cursor)
        body = s.StBody(start.to(cursor.place()), statements)
    cursor.expect("END_ACTION", code="P0011")
    cursor.accept(";")
    return s.Action(name.span, name.text, body)
