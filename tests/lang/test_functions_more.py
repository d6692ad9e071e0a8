"""The user's functions: outputs, in-outs, defaults, calls from each other, in ST and IL."""

import pytest
from controller import Controller, findings, main

from plcemu.base.errors import CompileError
from plcemu.lang.compile import compile_program

POUS = """
FUNCTION divide : BOOL
VAR_INPUT n : INT; part : INT := 10; END_VAR
VAR_OUTPUT quotient, rest : INT; END_VAR
divide := part <> 0;
IF NOT divide THEN RETURN; END_IF;
quotient := n / part; rest := n MOD part;
END_FUNCTION

FUNCTION swap : INT
VAR_IN_OUT a, b : INT; END_VAR
VAR kept : INT; END_VAR
LD a
ST kept
LD b
ST a
LD kept
ST b
ADD a
ST swap
END_FUNCTION

FUNCTION largest : INT
VAR_INPUT list : ARRAY[1..4] OF INT; END_VAR
VAR i : INT; END_VAR
largest := list[1];
FOR i := 2 TO 4 DO largest := MAX(largest, list[i]); END_FOR;
END_FUNCTION

FUNCTION square : INT VAR_INPUT x : INT; END_VAR square := x * x; END_FUNCTION
FUNCTION quartic : INT VAR_INPUT x : INT; END_VAR quartic := square(square(x)); END_FUNCTION
FUNCTION wait : INT
VAR_INPUT n : INT; END_VAR
again: LD wait
ADD 1
ST wait
LT n
JMPC again
END_FUNCTION
"""
VARIABLES = ("q : BOOL; i : INT := 7; k : INT := 2; n, m : INT; "
             "f : ARRAY[1..4] OF INT := [3, 9, -4, 1]; g : ARRAY[0..1] OF INT := [5, 6];")


@pytest.mark.parametrize(("text", "expected"), [
    ("q := divide(n := 47, quotient => n, rest => m);", {"n": 4, "m": 7, "q": True}),
    ("divide(n := 47, part := 6, rest => m);", {"m": 5}),
    ("divide(47, 6);", {"n": 0}),
    ("q := divide(47, 0);", {"q": False}),
    ("divide(n := 47, quotient => g[1]); n := g[1];", {"n": 4}),
    ("n := swap(i, k);", {"i": 2, "k": 7, "n": 9}),
    ("n := swap(a := g[0], b := i);", {"i": 5, "g[0]": 7, "n": 12}),
    ("swap(g[0], g[1]);", {"g[0]": 6, "g[1]": 5}),
    ("n := largest(f) + largest(list := f);", {"n": 18}),
    ("n := quartic(k) + square(quartic(1) + square(k));", {"n": 16 + 25}),
    ("n := wait(5) + wait(3);", {"n": 8}),
    ("LD k\nquartic\nST n\nLD k\nsquare\nADD n\nST m", {"n": 16, "m": 20}),
    ("swap(a := i, b := k)\nST n", {"i": 2, "k": 7, "n": 9}),
    ("LD f\nlargest\nST n", {"n": 9}),
    ("divide(\nn := 47,\nrest => m\n)\nST q", {"m": 7, "q": True}),
])
def test_functions_are_called_with_every_kind_of_parameter(text, expected):
    controller = Controller(main(VARIABLES, text) + POUS).scan()
    assert {name: controller[name] for name in expected} == expected


def test_a_function_begins_anew_at_every_call():
    controller = Controller(main(VARIABLES, "n := wait(4);") + POUS)
    assert controller.values(3, "n") == [4, 4, 4]


@pytest.mark.parametrize(("text", "expected"), [
    ("swap(i, 5);", "5:9: P0024"), ("swap(i);", "5:1: P0026"), ("n := square();", "5:6: P0026"),
    ("n := square(1, 2);", "5:6: P0026"), ("n := square(y := 2);", "5:13: P0026"),
    ("n := divide(n := 5);", "5:6: P0023"), ("divide(n := 5, foo => n);", "5:16: P0026"),
    ("n := squar(2);", "5:6: P0020"), ("swap(q, i);", "5:6: P0023"),
    ("LD i\nswap k\nST n", "6:1: P0024"), ("LD i\nsquare\nADD j\nST n", "7:5: P0020"),
])
def test_mistakes_in_calls_of_functions_are_diagnosed(text, expected):
    found = [f for f in findings(main(VARIABLES, text) + POUS) if "P007" not in f]
    assert found == [expected]


def test_recursion_is_told_with_the_way_it_goes():
    text = ("FUNCTION a : INT VAR_INPUT n : INT; END_VAR a := b(n); END_FUNCTION\n"
            "FUNCTION b : INT VAR_INPUT n : INT; END_VAR LD n\nc\nST b\nEND_FUNCTION\n"
            "FUNCTION c : INT VAR_INPUT n : INT; END_VAR c := a(n - 1); END_FUNCTION\n"
            + main("n : INT;", "n := a(3);"))
    with pytest.raises(CompileError, match=r"a calls itself: a calls b calls c calls a") as caught:
        compile_program(text)
    assert [str(d)[:17] for d in caught.value.diagnostics] == ["<text>:1:10: P006"]


def test_functions_in_another_file_are_operators_too():
    program = compile_program([main(VARIABLES, "LD k\nquartic\nST n"), POUS])
    assert Controller(program).scan()["n"] == 16


def test_a_variable_that_is_only_handed_on_counts_as_used():
    text = ("VAR_GLOBAL shared : INT; END_VAR\n" + POUS +
            "PROGRAM p VAR_EXTERNAL shared : INT; END_VAR VAR a, b : INT; f : ARRAY[1..4] OF INT; "
            "o AT %QX0.0 : BOOL; END_VAR swap(a, b); shared := largest(f); "
            "divide(n := 5, rest => shared); o := divide(n := 3); END_PROGRAM\n")
    assert findings(text) == []
