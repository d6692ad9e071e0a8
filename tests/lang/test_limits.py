"""The stated limits (docs/language.md): what is at them compiles, what is beyond is diagnosed."""

import pytest
from controller import Controller, evaluate, findings, main

from plcemu.lang.cursor import NESTING_LIMIT
from plcemu.lang.scopebuilder import MEMORY_LIMIT
from plcemu.lang.typebuilder import ELEMENT_LIMIT


def codes(text):
    return sorted({finding[-5:] for finding in findings(text)})


def nested_blocks(depth):
    """Function blocks each of which holds an instance of the one that follows in the text."""
    blocks = ["FUNCTION_BLOCK b0 VAR n : INT; END_VAR n := n + 1; END_FUNCTION_BLOCK"]
    blocks += [f"FUNCTION_BLOCK b{n} VAR b : b{n - 1}; END_VAR b(); END_FUNCTION_BLOCK"
               for n in range(1, depth)]
    return "\n".join(reversed(blocks)) + "\n" + main(f"b : b{depth - 1};", "b();")


@pytest.mark.parametrize("make", [
    lambda n: main("x : BOOL;", "x := " + "(" * (n - 2) + "x" + ")" * (n - 2) + ";"),
    lambda n: main("x : BOOL;", "IF x THEN " * (n - 2) + "x := x;" + "END_IF;" * (n - 2)),
    lambda n: main("x : BOOL;", "LD x\n" + "AND(\nLD x\n" * n + ")\n" * n + "ST x"),
    lambda n: main("r : REAL;", "r := 1.0" + " ** 1.0" * n + ";"),
    lambda n: nested_blocks(n - 1),
], ids=["parentheses", "statements", "parentheses in IL", "powers", "blocks"])
def test_nesting_up_to_the_limit_compiles_and_one_more_is_told(make):
    assert codes(make(NESTING_LIMIT)) == []
    assert codes(make(NESTING_LIMIT + 3)) == ["P0014"]


def test_arrays_up_to_the_limit_compile():
    body = f"a[{ELEMENT_LIMIT}] := 5; x := a[{ELEMENT_LIMIT}];"
    assert evaluate(f"a : ARRAY [1..{ELEMENT_LIMIT}] OF SINT; x : SINT;", body, "x") == 5
    assert codes(main(f"a : ARRAY [0..{ELEMENT_LIMIT}] OF SINT;", "a[0] := 1;")) == ["P0100"]


def test_instances_up_to_the_limit_compile():
    size = MEMORY_LIMIT // 8
    assert codes(main(f"a : ARRAY [1..{size}] OF LINT;", "a[1] := 1;")) == []
    assert codes(main(f"a, b : ARRAY [1..{size}] OF LINT;", "a[1] := 1; b[1] := 1;")) == ["P0100"]


def test_strings_up_to_the_limit_compile():
    assert evaluate("s : STRING[65535]; x : INT;", "s := 'ab'; IF s = 'ab' THEN x := 1; END_IF;",
                    "x") == 1
    assert codes(main("s : STRING[65536]; t : STRING[0];", "s := 'a'; t := s;")) == ["P0025"]


def test_extensible_functions_take_64_inputs():
    assert evaluate("x : INT;", f"x := MAX({', '.join(map(str, range(64)))});", "x") == 63
    assert codes(main("x : INT;", f"x := MAX({', '.join(map(str, range(65)))});")) == ["P0026"]


@pytest.mark.parametrize(("declared", "body", "x"), [
    ("x : INT;", "x := 1" + " + 1" * 9_999 + ";", 10_000),
    ("x : INT := 1" + " + 1" * 9_999 + ";", "x := x + 0;", 10_000),
    ("x : INT; a : ARRAY [0..9] OF INT;", "a[1" + "+ 1 - 1" * 5_000 + "] := 7; x := a[1];", 7),
    ("x : INT;", "IF x = 1 THEN x := 2; " + "ELSIF x = 2 THEN x := 3; " * 3_000
     + "ELSE x := 4; END_IF;", 4),
    ("x : INT := 2999;", "CASE x OF " + " ".join(f"{n}: x := {n + 1};" for n in range(3_000))
     + " END_CASE;", 3_000),
    ("x : INT;", "x := 5; " * 10_000, 5),
    (" ".join(f"v{n} : INT;" for n in range(5_000)) + "x : INT;", "v4999 := 3; x := v4999;", 3),
], ids=["sum", "constant sum", "subscript", "ELSIF", "CASE", "statements", "variables"])
def test_what_stands_in_a_row_has_no_limit(declared, body, x):
    assert evaluate(declared, body, "x") == x


def test_many_functions_may_call_each_other_in_a_chain():
    chain = "".join(f"FUNCTION f{n} : INT VAR_INPUT a : INT; END_VAR f{n} := f{n + 1}(a) + 1;"
                    "END_FUNCTION\n" for n in range(200))
    last = "FUNCTION f200 : INT VAR_INPUT a : INT; END_VAR f200 := a; END_FUNCTION\n"
    assert Controller(chain + last + main("x : INT;", "x := f0(5);")).scan()["x"] == 205
