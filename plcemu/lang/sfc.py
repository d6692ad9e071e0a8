"""Sequential Function Chart as text (IEC 61131-3, 2.6)."""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor, SyntaxFailure
from plcemu.lang.il import looks_like_il, parse_il
from plcemu.lang.st import name_from, parse_expression, parse_statements

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
    return s.SfcBody(start.to(cursor.place()), tuple(steps),
                     tuple(t for t in transitions if t.sources), tuple(actions),
                     tuple(t for t in transitions if not t.sources))


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
    variable = _variable(cursor, "an action block or END_STEP")
    text = variable.head if isinstance(variable, s.Name) else variable.address
    simple = isinstance(variable, s.Name) and len(variable.parts) == 1
    if not simple:
        span = variable.span
        text = "".join(span.source.text[span.start:span.end].split())
    qualifier, time = "N", None
    indicators: list[s.Name | s.Direct] = []
    if cursor.accept("("):
        if not cursor.at(")"):
            qualifier, time, indicators = _qualifier(cursor)
        cursor.expect(")", "to close the action block", "P0011")
    return s.Association(variable.span, text, qualifier, time, tuple(indicators),
                         None if simple else variable)


def _variable(cursor: Cursor, what: str) -> s.Name | s.Direct:
    if cursor.token.kind == "direct":
        token = cursor.advance()
        return s.Direct(token.span, token.text)
    return name_from(cursor, cursor.identifier(what))


def _qualifier(cursor: Cursor) -> tuple[str, s.Expr | None, list[s.Name | s.Direct]]:
    """Parse the qualifier, its time if it takes one, and indicator variables."""
    token = cursor.advance()
    if token.upper not in QUALIFIERS:
        cursor.report.error("P0052", token.span, f"{token.text!r} is not an action qualifier; "
                            f"there are {' '.join(QUALIFIERS)}")
        cursor.skip_to(")", ";", "END_STEP")
        return "N", None, []
    timed = QUALIFIERS[token.upper]
    time = parse_expression(cursor) if cursor.at(",") and cursor.advance() else None
    indicators: list[s.Name | s.Direct] = []
    if not timed and isinstance(time, s.Name | s.Direct):
        indicators, time = [time], None
    while cursor.accept(","):
        indicators.append(_variable(cursor, "an indicator variable"))
    if timed and time is None:
        cursor.report.error("P0053", token.span, f"qualifier {token.text} needs a time, such as "
                            f"({token.text}, T#5s)")
    elif not timed and time is not None:
        cursor.report.error("P0053", time.span, f"qualifier {token.text} takes no time")
        time = None
    return token.upper, time, indicators


def _transition(cursor: Cursor) -> s.Transition:
    start, name, priority = cursor.advance().span, "", None
    if not cursor.at("FROM", "("):
        token = cursor.identifier("FROM or the transition's name")
        start, name = start.to(token.span), token.text
        if cursor.at(":", ":="):
            return s.Transition(start, name, None, (), (), _condition(cursor))
    if cursor.accept("("):
        cursor.expect("PRIORITY")
        cursor.expect(":=", "after PRIORITY")
        if cursor.token.kind != "int":
            raise cursor.failure("a whole number as priority")
        priority = int(cursor.advance().value)
        cursor.expect(")", "after the priority", "P0011")
    cursor.expect("FROM")
    sources = node_names(cursor, "a step's name")
    cursor.expect("TO")
    targets = node_names(cursor, "a step's name")
    span = start.to(cursor.previous.span)
    if name and (cursor.at("END_TRANSITION") or cursor.accept(";")):
        cursor.expect("END_TRANSITION", code="P0011")
        cursor.accept(";")
        return s.Transition(span, name, priority, sources, targets, None)
    return s.Transition(span, name, priority, sources, targets, _condition(cursor))


def _condition(cursor: Cursor) -> s.Expr | s.IlBody:
    """Parse a condition in ST or IL and END_TRANSITION."""
    condition: s.Expr | s.IlBody
    if cursor.accept(":="):
        condition = parse_expression(cursor)
        cursor.expect(";", "after the condition")
    else:
        cursor.expect(":", "or ':=' before the transition's condition")
        condition = parse_il(cursor)
    cursor.expect("END_TRANSITION", code="P0011")
    cursor.accept(";")
    return condition


def node_names(cursor: Cursor, what: str) -> tuple[s.Name, ...]:
    """Parse the steps or places on one side of a transition: one, or several in parentheses."""
    def one() -> s.Name:
        token = cursor.identifier(what)
        return s.Name(token.span, (token.text,))

    if not cursor.accept("("):
        return (one(),)
    names = [one()]
    while cursor.accept(","):
        names.append(one())
    cursor.expect(")", "after the names", "P0011")
    return tuple(names)


def _chart_in_action(cursor: Cursor) -> s.StBody:
    """Read over a chart inside an action, which 2.6.4.1 allows and this compiler does not."""
    cursor.report.error("P0090", cursor.token.span, "an action whose body is a chart is not "
                        "supported yet; make the chart a FUNCTION_BLOCK and call it in the action")
    cursor.enter()
    try:
        return s.StBody(parse_sfc(cursor).span, ())
    finally:
        cursor.leave()


def _action(cursor: Cursor) -> s.Action:
    cursor.advance()
    name = cursor.identifier("the action's name")
    cursor.expect(":", "after the action's name")
    body: s.IlBody | s.StBody
    if cursor.at(*ELEMENTS[:3]):
        body = _chart_in_action(cursor)
    elif looks_like_il(cursor):
        body = parse_il(cursor)
    else:
        start = cursor.place()
        statements = parse_statements(cursor)
        body = s.StBody(start.to(cursor.place()), statements)
    cursor.expect("END_ACTION", code="P0011")
    cursor.accept(";")
    return s.Action(name.span, name.text, body)
