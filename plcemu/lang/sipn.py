"""Signal Interpreted Petri Nets as text (docs/sipn.md has the grammar).

The words are those of a chart's text: places stand like steps, transitions like transitions.
"""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.cursor import Cursor, SyntaxFailure
from plcemu.lang.sfc import node_names
from plcemu.lang.st import name_from, parse_expression

_PLACES = ("INITIAL_PLACE", "PLACE")
_ELEMENTS = (*_PLACES, "TRANSITION")
_CLOSERS = ("END_PLACE", "END_TRANSITION")
_STOPS = (*_ELEMENTS, *_CLOSERS, "END_PROGRAM", "END_FUNCTION_BLOCK", "END_FUNCTION")

FLAGS = ("eoc", "conflict", "undefined", "contradictory")
"""What every net tells of itself, each a BOOL of its POU (docs/sipn.md)."""


def looks_like_sipn(cursor: Cursor) -> bool:
    """Whether a body that starts here is a net; `place` alone may be a variable of another."""
    return cursor.at(*_PLACES) and cursor.peek().kind == "name"


def parse_sipn(cursor: Cursor) -> s.SipnBody:
    """Parse places and transitions in any order, up to the end of the POU."""
    start = cursor.place()
    places: list[s.NetPlace] = []
    transitions: list[s.NetTransition] = []
    while cursor.at(*_ELEMENTS):
        try:
            if cursor.at("TRANSITION"):
                transitions.append(_transition(cursor))
            else:
                places.append(_place(cursor))
        except SyntaxFailure:
            cursor.skip_to(*_STOPS, over=_CLOSERS)
    return s.SipnBody(start.to(cursor.previous.span), tuple(places), tuple(transitions))


def _place(cursor: Cursor) -> s.NetPlace:
    initial = cursor.advance().upper == "INITIAL_PLACE"
    name = cursor.identifier("the place's name")
    cursor.expect(":", "after the place's name")
    outputs: list[s.NetOutput] = []
    cursor.mend_closer()
    while not cursor.at("END_PLACE"):
        outputs.append(_output(cursor))
        cursor.expect(";", "after the output's value")
        cursor.mend_closer()
    cursor.expect("END_PLACE", code="P0011")
    cursor.accept(";")
    return s.NetPlace(name.span, name.text, initial, tuple(outputs))


def _output(cursor: Cursor) -> s.NetOutput:
    token = cursor.token
    target: s.Name | s.Direct
    if token.kind == "direct":
        cursor.advance()
        target = s.Direct(token.span, token.text)
    else:
        target = name_from(cursor, cursor.identifier("an output or END_PLACE"))
    cursor.expect(":=", "after the output")
    value = cursor.token
    if value.kind not in ("bool", "int") or value.value not in (0, 1):
        raise cursor.failure("0, 1, FALSE or TRUE as the output's value")
    cursor.advance()
    return s.NetOutput(target.span, target, bool(value.value))


def _transition(cursor: Cursor) -> s.NetTransition:
    cursor.advance()
    name = cursor.identifier("the transition's name")
    cursor.expect("FROM", "and the places before the transition")
    sources = _side(cursor)
    cursor.expect("TO", "and the places after the transition")
    targets = _side(cursor)
    cursor.expect(":=", "before the transition's condition")
    condition = parse_expression(cursor)
    cursor.expect(";", "after the condition")
    cursor.expect("END_TRANSITION", code="P0011")
    cursor.accept(";")
    return s.NetTransition(name.span, name.text, sources, targets, condition)


def _side(cursor: Cursor) -> tuple[s.Name, ...]:
    """Parse the places on one side of a transition; `()` is none."""
    if cursor.at("(") and cursor.peek().text == ")":
        cursor.advance()
        cursor.advance()
        return ()
    return node_names(cursor, "a place's name")
