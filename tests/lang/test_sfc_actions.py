"""Action blocks: Boolean variables of every kind, indicators, variable times (tables 43 to 45)."""

import pytest
from controller import MS, Controller, findings

TYPES = "TYPE S : STRUCT b : BOOL; n : INT; END_STRUCT; END_TYPE\n"
CHART = TYPES + """
VAR_GLOBAL g : BOOL; END_VAR
PROGRAM MAIN
VAR go, out, done : BOOL; n : INT; list : ARRAY[0..3] OF BOOL; s : S; k : INT := 2;
 d : TIME := T#20ms;
 {declared} END_VAR
VAR_EXTERNAL g : BOOL; END_VAR
INITIAL_STEP A: {a} END_STEP
STEP B: {b} END_STEP
TRANSITION FROM A TO B := go; END_TRANSITION
TRANSITION FROM B TO A := NOT go; END_TRANSITION
{more}
END_PROGRAM
"""


def two_steps(a="", b="", declared="", more=""):
    return Controller(CHART.format(a=a, b=b, declared=declared, more=more))


@pytest.mark.parametrize(("block", "tag"), [
    ("s.b(N);", "s.b"), ("list[1](N);", "list[1]"), ("list[k](N);", "list[2]"),
    ("%QX0.1(N);", "%QX0.1"), ("g(N);", "g"), ("list [ 3 ] (N);", "list[3]"), ("S.B;", "s.b"),
])
def test_any_boolean_variable_is_an_action(block, tag):
    assert two_steps(b=block).diagram({"go": "__--__"}, [tag]) == {tag: "__--__"}


@pytest.mark.parametrize("target", ["s.b", "list[1]", "%QX0.1"])
def test_s_and_r_on_a_part_of_a_variable_share_one_memory(target):
    controller = two_steps(b=f"{target}(S);", a=f"{target}(R);")
    assert controller.diagram({"go": "__--__"}, [target]) == {target: "__--__"}


def test_two_elements_of_an_array_are_two_actions():
    controller = two_steps(b="list[0](S); list[1](L, T#10ms);")
    found = controller.diagram({"go": "_---_"}, ["list[0]", "list[1]"])
    assert found == {"list[0]": "_----", "list[1]": "_-___"}


def test_a_time_may_be_any_expression_and_is_taken_while_the_step_is_active():
    controller = two_steps(b="out(L, d * 2);")
    assert controller.diagram({"go": "_------_"}, ["out"]) == {"out": "_----___"}


def test_a_time_may_be_the_elapsed_time_of_a_step():
    controller = two_steps(b="out(D, A.T);")
    assert controller.diagram({"go": "___-----"}, ["out"]) == {"out": "______--"}
    assert controller["A.T"] == 30 * MS


def test_indicator_variables_are_read_and_not_written():
    controller = two_steps(b="out(N, done); list[0](L, T#10ms, s.b, %QX0.0);")
    assert controller.diagram({"go": "_--"}, ["out", "done", "s.b"]) == {
        "out": "_--", "done": "___", "s.b": "___"}


def test_an_indicator_counts_as_a_use_of_its_variable():
    text = CHART.format(a="", b="out(N, done);", declared="", more="")
    assert "done" not in " ".join(findings(text))


@pytest.mark.parametrize(("block", "code"), [
    ("out(N, n);", "P0023"), ("out(N, nowhere);", "P0020"), ("out(L, T#1s, n);", "P0023"),
    ("s.n(N);", "P0054"), ("%QW0(N);", "P0054"), ("s.x(N);", "P0020"), ("list[9](N);", "P0025"),
    ("out(N, T#1s);", "P0053"), ("out(L);", "P0053"), ("out(X);", "P0052"),
])
def test_a_mistake_in_an_action_block_has_its_code(block, code):
    text = CHART.format(a="", b=block, declared="", more="")
    assert [f[-5:] for f in findings(text) if "P0070" not in f] == [code]


def test_a_chart_as_the_body_of_an_action_is_told_at_its_first_step():
    more = "ACTION inner:\nINITIAL_STEP X: END_STEP\nACTION y: n := 1; END_ACTION END_ACTION"
    text = CHART.format(a="inner(N);", b="", declared="", more=more)
    assert [f[-5:] for f in findings(text) if "P0070" not in f] == ["P0090"]


def test_the_same_p_action_on_three_steps_in_a_row_runs_three_times():
    controller = Controller("""
        PROGRAM MAIN VAR n : INT; END_VAR
        INITIAL_STEP A: count(P); END_STEP STEP B: count(P); END_STEP STEP C: count(P1); END_STEP
        TRANSITION FROM A TO B := TRUE; END_TRANSITION
        TRANSITION FROM B TO C := TRUE; END_TRANSITION
        ACTION count: n := n + 1; END_ACTION END_PROGRAM""")
    assert controller.values(5, "n") == [1, 2, 3, 3, 3]


@pytest.mark.parametrize(("qualifier", "reset_at"), [("SD", 4), ("DS", 4), ("SL", 4)])
def test_r_cancels_a_counting_qualifier_that_never_comes_back(qualifier, reset_at):
    controller = Controller(f"""
        PROGRAM MAIN VAR go, reset, out : BOOL; END_VAR
        INITIAL_STEP A: END_STEP STEP B: out({qualifier}, T#50ms); END_STEP
        INITIAL_STEP O: END_STEP STEP C: out(R); END_STEP
        TRANSITION FROM A TO B := go; END_TRANSITION
        TRANSITION FROM O TO C := reset; END_TRANSITION END_PROGRAM""")
    reset = "_" * reset_at + "-" * 12
    found = controller.diagram({"go": "_" + "-" * 15, "reset": reset}, ["out"])["out"]
    assert found[reset_at:] == "_" * 12


def test_actions_run_once_a_scan_in_every_order_of_their_blocks():
    controller = two_steps(a="one(N); two(N); one(P1);", more=(
        "ACTION two: n := n * 10; END_ACTION ACTION one: n := n + 1; END_ACTION"))
    assert controller.values(2, "n") == [10, 110]
