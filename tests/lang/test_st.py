"""Structured Text: precedence, statements and calls (IEC 61131-3, 3.3)."""

import pytest
from controller import Controller, evaluate, findings, main
from hypothesis import given, settings
from hypothesis import strategies as st

# ---------------------------------------------------------------- expressions

LEVEL = {"OR": 0, "XOR": 1, "AND": 2, "=": 3, "<>": 3, "<": 4, ">": 4, "<=": 4, ">=": 4,
         "+": 5, "-": 5, "*": 6, "/": 6, "MOD": 6}
"""Precedence of the operators, the loosest first (table 55)."""


def quotient(a, b):
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


def wrapped(value):
    return (value + 2**31) % 2**32 - 2**31


MEANING = {
    "OR": lambda a, b: a or b, "XOR": lambda a, b: a != b, "AND": lambda a, b: a and b,
    "=": lambda a, b: a == b, "<>": lambda a, b: a != b, "<": lambda a, b: a < b,
    ">": lambda a, b: a > b, "<=": lambda a, b: a <= b, ">=": lambda a, b: a >= b,
    "+": lambda a, b: wrapped(a + b), "-": lambda a, b: wrapped(a - b),
    "*": lambda a, b: wrapped(a * b),
    "/": lambda a, b: wrapped(quotient(a, b or 1)),
    "MOD": lambda a, b: a - b * quotient(a, b or 1) if b else 0,
}
NUMBERS = {"i": 7, "k": -3, "m": 2_000_000_000}
FLAGS = {"p": True, "q": False}


def numbers(depth):
    leaf = st.sampled_from(sorted(NUMBERS)) | st.integers(0, 99).map(str)
    if not depth:
        return leaf
    inner = numbers(depth - 1)
    return leaf | st.tuples(st.sampled_from(["+", "-", "*"]), inner, inner) \
        | st.tuples(st.sampled_from(["/", "MOD"]), inner, st.sampled_from(["k", "5", "i"]))


def flags(depth):
    leaf = st.sampled_from(sorted(FLAGS))
    if not depth:
        return leaf
    comparison = st.tuples(st.sampled_from(["=", "<>", "<", ">", "<=", ">="]), numbers(1),
                           numbers(1))
    inner = flags(depth - 1)
    return leaf | comparison | st.tuples(st.sampled_from(["OR", "XOR", "AND", "=", "<>"]),
                                         inner, inner)


def written(tree, level=0):
    """Return the text with as few parentheses as the precedence allows; operators lean left."""
    if isinstance(tree, str):
        return tree
    op, left, right = tree
    own = LEVEL[op]
    text = f"{written(left, own)} {op} {written(right, own + 1)}"
    return f"({text})" if own < level else text


def value(tree):
    if isinstance(tree, str):
        return {**NUMBERS, **FLAGS}.get(tree) if not tree.isdigit() else int(tree)
    return MEANING[tree[0]](value(tree[1]), value(tree[2]))


DECLARED = ("i : DINT := 7; k : DINT := -3; m : DINT := 2000000000; p : BOOL := TRUE; q : BOOL;"
            "n : DINT; x : BOOL;")


@given(numbers(4))
@settings(max_examples=150, deadline=None)
def test_random_arithmetic_follows_the_table_of_precedence(tree):
    assert evaluate(DECLARED, f"n := {written(tree)};", "n") == value(tree)


@given(flags(4))
@settings(max_examples=150, deadline=None)
def test_random_conditions_follow_the_table_of_precedence(tree):
    assert evaluate(DECLARED, f"x := {written(tree)};", "x") == value(tree)


@pytest.mark.parametrize(("text", "expected"), [
    ("NOT p OR p", True), ("NOT (p OR p)", False), ("NOT NOT p", True), ("p & q", False),
    ("-i + 10 = 3", True), ("- (i - 10) = 3", True), ("-i < 0 AND NOT q", True), ("+i = i", True),
    ("i = 7 AND k = -3", True), ("p = (i > k)", True), ("1 < 2", True), ("100000 > 5", True),
    ("1.5 > 1", True), ("i > 16#FF", False), ("p XOR p OR p", True), ("TRUE AND BOOL#0", False),
    ("T#1s = T#1000ms", True), ("T#1m30s > T#89s", True), ("-T#1s < T#0s", True),
])
def test_conditions(text, expected):
    assert evaluate(DECLARED, f"x := {text};", "x") is expected


@pytest.mark.parametrize(("declared", "text", "expected"), [
    ("n : REAL;", "5 / 2", 2.5), ("n : INT;", "5 / 2", 2), ("n : REAL;", "1 + 0.5", 1.5),
    ("n : DINT; i : INT := 30000;", "i", 30000), ("n : DINT;", "30000 + 30000", 60000),
    ("n : INT; i : INT := -32768;", "-i", -32768), ("n : DINT; i : INT := -32768;", "-i", -32768),
    ("n : TIME; k : INT := 3;", "T#1.5s * k + T#1ms", 4_501_000_000),
    ("n : TIME; k : INT := 3;", "T#6s / k", 2_000_000_000), ("n : TIME;", "T#1h", 3600 * 10**9),
    ("n : TIME;", "-T#5s", -5 * 10**9), ("n : TIME;", "T#-5s", -5 * 10**9),
    ("n : TIME;", "TIME#1d2h3m4s5ms6us7ns", 93784005006007),
    ("n : WORD; w : WORD;", "NOT w", 65535),
    ("n : UINT;", "65535", 65535), ("n : SINT;", "-128", -128), ("n : LREAL;", "1.0E300", 1e300),
    ("n : LREAL;", "REAL#0.5", 0.5), ("n : LINT;", "-9223372036854775808", -2**63),
    ("n : BYTE;", "2#1111_0000", 240), ("n : BOOL;", "1", True), ("n : REAL;", "7", 7.0),
    ("n : ULINT;", "16#FFFF_FFFF_FFFF_FFFF", 2**64 - 1), ("n : LTIME;", "LTIME#5us", 5000),
])
def test_values_of_every_kind(declared, text, expected):
    assert evaluate(declared, f"n := {text};", "n") == expected


# ---------------------------------------------------------------- statements


@pytest.mark.parametrize(("i", "expected"), [(0, 10), (1, 20), (2, 30), (3, 40)])
def test_if_takes_the_first_true_branch(i, expected):
    body = ("IF i = 0 THEN n := 10; ELSIF i = 1 THEN n := 20; ELSIF i <= 2 THEN n := 30;"
            "ELSE n := 40; END_IF;")
    assert evaluate("i, n : INT;", body, "n", i=i) == expected


@pytest.mark.parametrize(("i", "expected"), [
    (1, 10), (2, 20), (3, 20), (4, 0), (5, 30), (7, 30), (9, 30), (10, 0), (-1, 40), (-5, 40)])
def test_case_takes_the_branch_that_holds_the_value(i, expected):
    body = ("CASE i OF 1: n := 10; 2, 3: n := 20; 5..9: n := 30; -5..-1: n := 40;"
            "ELSE n := 0; END_CASE;")
    assert evaluate("i : INT; n : INT := 99;", body, "n", i=i) == expected


def test_case_without_a_branch_for_the_value_does_nothing():
    assert evaluate("i : INT; n : INT := 99;", "CASE i OF 1: n := 10; END_CASE;", "n") == 99


def test_branches_of_case_hold_several_statements_and_nested_cases():
    body = ("CASE i OF 0: n := 1; CASE n OF 1: n := n + 1; n := n * 10; 2: n := 7; END_CASE;"
            "n := n + 1; 1: n := 2; END_CASE;")
    assert evaluate("i, n : INT;", body, "n") == 21


@pytest.mark.parametrize(("of", "loop", "count", "last"), [
    ("INT", "1 TO 5", 5, 6), ("INT", "5 TO 1", 0, 5), ("INT", "5 TO 1 BY -1", 5, 0),
    ("INT", "1 TO 5 BY 2", 3, 7), ("INT", "0 TO 0", 1, 1), ("INT", "1 TO 5 BY -1", 0, 1),
    ("SINT", "120 TO 127", 8, 127), ("SINT", "-120 TO -128 BY -1", 9, -128),
    ("SINT", "100 TO 127 BY 100", 1, 100), ("USINT", "250 TO 255", 6, 255),
    ("LINT", "9223372036854775800 TO 9223372036854775807", 8, 2**63 - 1),
    ("ULINT", "18446744073709551610 TO 18446744073709551615 BY 2", 3, 2**64 - 2),
])
def test_for_counts_and_never_runs_past_the_end_of_its_type(of, loop, count, last):
    declared = f"i : {of}; n : INT;"
    body = f"n := 0; FOR i := {loop} DO n := n + 1; END_FOR;"
    assert (evaluate(declared, body, "n"), evaluate(declared, body, "i")) == (count, last)


def test_the_end_and_the_step_of_for_are_evaluated_once():
    body = "FOR i := 1 TO k BY m DO n := n + 1; k := 0; m := 5; END_FOR;"
    assert evaluate("i, n : INT; k : INT := 3; m : INT := 1;", body, "n") == 3


def test_a_step_of_zero_is_a_runaway_loop():
    controller = Controller(main("i : INT;", "FOR i := 1 TO 2 BY 0 DO ; END_FOR;"), budget=5_000)
    assert "does not end" in controller.scan().resource.fault.reason


def test_while_tests_first_and_repeat_last():
    body = ("WHILE a < 3 DO a := a + 1; END_WHILE; WHILE FALSE DO a := 99; END_WHILE;"
            "REPEAT b := b + 1; UNTIL b >= 3 END_REPEAT; REPEAT c := c + 1; UNTIL TRUE END_REPEAT;"
            "n := a * 100 + b * 10 + c;")
    assert evaluate("a, b, c, n : INT;", body, "n") == 331


def test_exit_leaves_the_innermost_loop():
    body = ("FOR i := 1 TO 3 DO k := 0; WHILE TRUE DO k := k + 1; n := n + 1;"
            "IF k = i THEN EXIT; END_IF; END_WHILE; END_FOR;")
    assert evaluate("i, k, n : INT;", body, "n") == 6


def test_return_leaves_the_program():
    assert evaluate("n : INT;", "n := 1; IF n = 1 THEN RETURN; END_IF; n := 2;", "n") == 1


def test_return_in_a_function_block_leaves_only_the_block():
    text = ("FUNCTION_BLOCK B VAR_INPUT a : BOOL; END_VAR VAR_OUTPUT n : INT; END_VAR\n"
            "n := 1; IF a THEN RETURN; END_IF; n := 2; END_FUNCTION_BLOCK\n"
            + main("f : B; m : INT;", "f(a := TRUE); m := f.n * 10;"))
    assert Controller(text).scan()["m"] == 10


def test_temporary_variables_start_anew_in_every_scan():
    text = ("PROGRAM MAIN VAR n : INT; END_VAR VAR_TEMP k : INT := 5; z : INT; r : REAL; END_VAR\n"
            "k := k + 1; z := z + 1; n := k * 10 + z; END_PROGRAM")
    assert Controller(text).values(2, "n") == [61, 61]


def test_a_temporary_real_begins_as_positive_zero_of_ieee_754():
    text = ("PROGRAM MAIN VAR y : REAL; END_VAR VAR_TEMP r : REAL; END_VAR\n"
            "y := 1.0 / -r; END_PROGRAM")
    assert Controller(text).scan()["y"] == float("-inf")


def test_real_literals_are_rounded_to_their_type():
    assert evaluate("r : REAL := 0.1; x : BOOL;", "x := r = 0.1;", "x") is True


@pytest.mark.parametrize("call",
                         ["t(CLK := a, Q => x);", "t(a); x := t.Q;", "t.CLK := a; t(); x := t.Q;",
                                  "t(CLK := a); x := t.q;", "T(a, Q => X);"])
def test_function_blocks_are_called_in_every_form(call):
    controller = Controller(main("t : R_TRIG; a, x : BOOL;", call))
    assert controller.diagram({"a": "_--_-"}, ["MAIN.x"]) == {"MAIN.x": "_-__-"}


def test_constants_and_retained_variables_are_declared():
    text = ("PROGRAM MAIN VAR CONSTANT c : INT := 5; END_VAR VAR RETAIN r : INT := 2; END_VAR\n"
            "r := r + c; END_PROGRAM")
    assert Controller(text).values(2, "r") == [7, 12]


def test_every_located_variable_stands_in_its_area():
    declared = ("a AT %IX0.7 : BOOL; b AT %QB3 : BYTE; c AT %MW5 : INT; d AT %QD0 : REAL;"
                "e AT %ML1 : LREAL; t AT %ML2 : TIME := T#1s; u AT %MD4 : UDINT := 7;")
    body = "b := 16#AB; c := -1; d := 0.5; e := 0.25; t := t * 2; u := u + 1;"
    controller = Controller(main(declared, body)).scan()
    assert [controller[a] for a in ("%QB3", "%MW5", "%QD0", "%ML1", "%ML2", "%MD4")] == [
        0xAB, -1, 0.5, 0.25, 2_000_000_000, 8]


# ---------------------------------------------------------------- size


def test_a_sum_of_five_thousand_terms_compiles():
    assert evaluate("n : INT;", "n := " + " + ".join(["1"] * 5000) + ";", "n") == 5000


def test_a_condition_of_five_thousand_terms_compiles():
    body = "x := " + " OR ".join(["a"] * 4999 + ["NOT a"]) + ";"
    assert evaluate("a, x : BOOL;", body, "x") is True


def test_fifty_parentheses_and_fifty_nested_statements_compile():
    assert findings(main("n : INT;", "n := " + "(" * 50 + "1" + ")" * 50 + ";")) == []
    assert findings(main("n : INT;", "IF n = 0 THEN " * 50 + "n := 1;" + "END_IF;" * 50)) == []
