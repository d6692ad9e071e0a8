"""EN and ENO of functions and function blocks (IEC 61131-3, 2.5.1.2 and 2.5.2.1a)."""

import pytest
from controller import Controller, findings, main

VARIABLES = ("c : BOOL; ok : BOOL := TRUE; no : BOOL; a : INT := 3; b : INT := 4; r : INT := 9; "
             "q : BOOL;")
TWICE = "FUNCTION twice : INT VAR_INPUT x : INT; END_VAR twice := 2 * x; END_FUNCTION\n"
COUNT = ("FUNCTION_BLOCK count VAR_INPUT part : INT := 1; END_VAR VAR_OUTPUT n : INT; END_VAR "
         "n := n + part; END_FUNCTION_BLOCK\n")


@pytest.mark.parametrize("text", [
    "r := ADD(EN := c, IN1 := a, IN2 := b, ENO => ok);",
    "r := ADD(IN1 := a, ENO => ok, IN2 := b, EN := c);",
    "r := twice(EN := c, x := a, ENO => ok) ; IF c THEN r := r + 1; END_IF;",
    "r := LIMIT(EN := c AND a = 3, MN := 0, IN := 8, MX := 7, ENO => ok);",
    ("ADD(\nEN := c,\nIN1 := a,\nIN2 := b,\nENO => ok\n)\nST no_matter\nLD ok\nJMPCN end\n"
     "LD no_matter\nST r\nend:"),
])
def test_while_en_is_false_a_call_assigns_nothing_and_eno_is_false(text):
    controller = Controller(main(VARIABLES + "no_matter : INT;", text) + TWICE).scan()
    assert (controller["r"], controller["ok"]) == (9, False)
    controller["c"] = True
    controller.scan()
    assert (controller["r"], controller["ok"]) == (7, True)


@pytest.mark.parametrize("text", [
    "t(EN := c, part := 2, n => r, ENO => ok);",
    "t(EN := c, part := 2, ENO => ok); r := t.n + SEL(c, 9, 0);",
    "CAL t(\nEN := c,\npart := 2,\nn => r,\nENO => ok\n)",
])
def test_while_en_is_false_a_function_block_is_not_run(text):
    controller = Controller(main(VARIABLES + "t : count;", text) + COUNT).scan(3)
    assert (controller["t.n"], controller["r"], controller["ok"]) == (0, 9, False)
    controller["c"] = True
    controller.scan(2)
    assert (controller["t.n"], controller["r"], controller["ok"]) == (4, 4, True)


def test_eno_without_en_is_true_and_may_be_negated():
    controller = Controller(main(VARIABLES, "ok := FALSE; r := MAX(a, b);"
                                 " r := MAX(IN1 := a, IN2 := b, ENO => ok, EN := TRUE);"
                                 " r := MIN(IN1 := a, IN2 := b, NOT ENO => no);")).scan()
    assert (controller["ok"], controller["no"], controller["r"]) == (True, False, 3)


def test_a_call_as_a_statement_has_en_and_eno_too():
    text = main(VARIABLES, "twice(EN := c, x := a, ENO => ok); q := ok;") + TWICE
    controller = Controller(text)
    assert controller.diagram({"c": "_-_-"}, ["q"]) == {"q": "_-_-"}


def test_a_pou_that_declares_en_and_eno_has_ordinary_variables():
    text = ("FUNCTION_BLOCK own VAR_INPUT EN : BOOL; END_VAR "
            "VAR_OUTPUT ENO : BOOL; n : INT; END_VAR "
            "n := n + 1; ENO := NOT EN; END_FUNCTION_BLOCK\n"
            "FUNCTION half : INT VAR_INPUT EN : BOOL := TRUE; x : INT; END_VAR "
            "VAR_OUTPUT ENO : BOOL; END_VAR "
            "ENO := EN AND x MOD 2 = 0; half := x / 2; END_FUNCTION\n"
            + main(VARIABLES + "o : own;",
                   "o(EN := c, ENO => ok); r := half(x := 8, ENO => q) + o.n;"))
    controller = Controller(text).scan(2)
    assert (controller["o.n"], controller["ok"], controller["q"], controller["r"]) == \
        (2, True, True, 6)


@pytest.mark.parametrize(("text", "expected"), [
    ("r := 1 + ADD(EN := c, IN1 := a, IN2 := b);", ["5:10: P0090"]),
    ("r := ADD(EN := a, IN1 := a, IN2 := b);", ["5:16: P0023"]),
    ("r := ADD(EN := c, IN1 := a, IN2 := b, ENO => 5);", ["5:46: P0024"]),
    ("r := ADD(EN := c, IN1 := a, IN2 := b, ENO => r);", ["5:39: P0023"]),
    ("r := ADD(EN := c, EN := c, IN1 := a, IN2 := b);", ["5:19: P0026"]),
    ("r := ADD(c, a, b, ENO => ok);", ["5:6: P0023"]),
])
def test_mistakes_at_en_and_eno_are_diagnosed(text, expected):
    assert [f for f in findings(main(VARIABLES, text)) if "P007" not in f] == expected
