"""The action qualifiers scan by scan (IEC 61131-3, 2.6.4.5, table 45 and figure 15).

A column of a line is one scan of 10 ms. Step A is active while `go` was FALSE, step B while it was
TRUE: B.X follows `go` from the second scan on. Step C follows `reset` in a branch of its own.
"""

import pytest
from controller import Controller

CHART = """
PROGRAM MAIN
VAR go, reset, out : BOOL; n : INT; END_VAR
INITIAL_STEP A: {a} END_STEP
STEP B: {b} END_STEP
INITIAL_STEP O: END_STEP
STEP C: out(R); END_STEP
TRANSITION FROM A TO B := go; END_TRANSITION
TRANSITION FROM B TO A := NOT go; END_TRANSITION
TRANSITION FROM O TO C := reset; END_TRANSITION
TRANSITION FROM C TO O := NOT reset; END_TRANSITION
END_PROGRAM
"""


def diagram(b, go, reset="", a=""):
    controller = Controller(CHART.format(a=a, b=b))
    lines = {"go": go, "reset": reset or "_" * len(go)}
    return controller.diagram(lines, ["out"])["out"]


@pytest.mark.parametrize(("block", "go", "out"), [
    ("out(N);", "__---__", "__---__"),
    ("out(S);", "__-____", "__-----"),
    ("out(P);", "__---__", "__-____"),
    ("out(P1);", "__---__", "__-____"),
    ("out(P0);", "__---__", "_____-_"),
    ("out(L, T#30ms);", "__------_", "__---____"),
    ("out(L, T#30ms);", "__--_----", "__--_---_"),
    ("out(L, T#0s);", "__--_", "_____"),
    ("out(D, T#30ms);", "__------_", "_____---_"),
    ("out(D, T#30ms);", "__--___-_", "_________"),
    ("out(D, T#0s);", "__--_", "__--_"),
    ("out(SD, T#30ms);", "__-______", "_____----"),
    ("out(DS, T#30ms);", "__-----__", "_____----"),
    ("out(DS, T#30ms);", "__--_____", "_________"),
    ("out(SL, T#30ms);", "__-______", "__---____"),
    ("out(SL, T#30ms);", "__------_", "__---____"),
    ("out(N); out(P0);", "__---__", "__----_"),
    ("out(L, T#20ms); out(D, T#40ms);", "__-------", "__--__---"),
])
def test_each_qualifier(block, go, out):
    assert diagram(block, go) == out


@pytest.mark.parametrize(("block", "go", "reset", "out"), [
    ("out(N);", "__-----_", "____--__", "__--__-_"),
    ("out(S);", "__-_____", "____-___", "__--____"),
    ("out(S);", "__---___", "___-____", "__-_----"),
    ("out(SD, T#30ms);", "__-_______", "____-_____", "__________"),
    ("out(SD, T#30ms);", "__-_______", "_______-__", "_____--___"),
    ("out(SL, T#50ms);", "__-_______", "____-_____", "__--______"),
    ("out(DS, T#30ms);", "__---------", "____----___", "________---"),
    ("out(DS, T#30ms);", "__------___", "_______-___", "_____--____"),
    ("out(DS, T#30ms);", "__-___-____", "____-______", "___________"),
    ("out(L, T#50ms);", "__--------", "____-_____", "__--_--___"),
    ("out(D, T#20ms);", "__--------", "_____-____", "____-_----"),
    ("out(P1);", "__---", "__---", "_____"),
])
def test_r_is_overriding_and_cancels_what_is_stored_or_counting(block, go, reset, out):
    assert diagram(block, go, reset) == out


def test_a_stored_action_is_reset_and_stored_again_by_two_steps_in_turn():
    assert diagram("out(S);", "__-_-_-_", a="out(R);") == "__-_-_-_"


def test_a_stored_delayed_action_counts_from_its_first_activation():
    assert diagram("out(SD, T#40ms);", "__-_-______") == "______-----"


def test_actions_with_a_body_run_in_every_scan_while_stored():
    text = CHART.format(a="", b="count(S);").replace(
        "END_PROGRAM", "ACTION count: n := n + 1; END_ACTION END_PROGRAM")
    controller = Controller(text)
    controller.diagram({"go": "__-___"}, [])
    assert controller["n"] == 4


def test_the_time_of_a_qualifier_may_be_a_variable():
    text = CHART.format(a="", b="out(D, delay);").replace("n : INT;", "delay : TIME := T#20ms;")
    assert Controller(text).diagram({"go": "_-----"}, ["out"]) == {"out": "___---"}


def test_one_action_may_have_different_times_at_different_steps():
    assert diagram("out(L, T#20ms);", "___---___--", a="out(L, T#30ms);").startswith("---")


def test_qualifiers_are_case_insensitive():
    assert diagram("out(sd, t#10ms);", "__-___") == "___---"
