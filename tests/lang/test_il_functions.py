"""Functions and function blocks in IL, in every form of call (IEC 61131-3, tables 53 and 54)."""

import pytest
from controller import Controller, evaluate, findings, main

from plcemu.base.errors import CompileError
from plcemu.lang.compile import compile_program

VARIABLES = ("a : INT := -7; b : INT := 3; c : INT := 12; n : INT; d : DINT; r : REAL; "
             "x : REAL := 2.0; p : BOOL := TRUE; q, z : BOOL; w : WORD := 16#00F1; v : WORD;"
             " s : STRING := 'abc'; u : STRING; f : ARRAY[0..3] OF INT := [5, 6, 7, 8];"
             " i : INT := 2; t : TIME := T#2s; g : TIME;")


@pytest.mark.parametrize(("text", "name", "expected"), [
    ("LD a\nABS\nST n", "n", 7),
    ("LD a\nMAX b, c\nST n", "n", 12),
    ("LD a\nMAX b,\n  c\nST n", "n", 12),
    ("LD a\nMIN -9, b\nST n", "n", -9),
    ("LD 1\nLIMIT c, 10\nST n", "n", 10),
    ("LD p\nSEL b, c\nST n", "n", 12),
    ("LD 1\nMUX a, b, c\nST n", "n", 3),
    ("LD c\nINT_TO_REAL\nST r", "r", 12.0),
    ("LD x\nREAL_TO_INT\nADD 5\nST n", "n", 7),
    ("LD 9.0\nSQRT\nST r", "r", 3.0),
    ("LD x\nEXPT 3\nST r", "r", 8.0),
    ("LD w\nSHL 4\nST v", "v", 0x0F10),
    ("LD w\nROR 4\nST v", "v", 0x100F),
    ("LD a\nADD b, c\nST n", "n", 8),
    ("LD b\nMUL 2, 2\nST n", "n", 12),
    ("LD b\nADD(\nLD a\nABS\n)\nST n", "n", 10),
    ("LD f[i]\nADD f[1]\nST f[0]\nLD f[0]\nST n", "n", 13),
    ("LD a\nMAX f[i], b\nST n", "n", 7),
    ("LD a\nABS\nST n\nST f[0]\nADD f[0]\nST d", "d", 14),
    ("LD t\nADD T#500ms\nST g", "g", 2_500_000_000),
    ("LD TIME#1s\nMUL 3\nST g", "g", 3_000_000_000),
    ("LD INT#16#10\nADD 1\nST n", "n", 17),
])
def test_a_function_takes_the_current_result_as_its_first_argument(text, name, expected):
    assert evaluate(VARIABLES, text, name) == expected


@pytest.mark.parametrize(("text", "name", "expected"), [
    ("LIMIT(\n  MN := 1,\n  IN := c,\n  MX := 10\n)\nST n", "n", 10),
    ("LIMIT(MN := 1, IN := c, MX := 10)\nST n", "n", 10),
    ("LIMIT(1, c, 10)\nST n", "n", 10),
    ("LD p\nST q\nMAX(\nIN1 := a,\nIN2 := b)\nADD 1\nST n", "n", 4),
    ("ADD(IN1 := a, IN2 := b)\nST n", "n", -4),
    ("GT(IN1 := b, IN2 := a)\nST q", "q", True),
    ("MAX(\nIN1 := (\nLD a\nADD 11\n),\nIN2 := b\n)\nST n", "n", 4),
    ("SEL(G := p, IN0 := b, IN1 := c)\nST n", "n", 12),
    ("LD 5\nADD(\nLD b\nMUL c\n)\nST n", "n", 41),
])
def test_a_function_called_formally_leaves_its_value_as_the_current_result(text, name, expected):
    assert evaluate(VARIABLES, text, name) == expected


STANDARD = [
    ("ABS", "IN := a", "INT"), ("SQRT", "IN := x", "REAL"), ("LN", "IN := x", "REAL"),
    ("EXPT", "IN1 := x, IN2 := b", "REAL"), ("SHL", "IN := w, N := 3", "WORD"),
    ("ROR", "IN := w, N := 5", "WORD"), ("SEL", "G := p, IN0 := a, IN1 := b", "INT"),
    ("MAX", "IN1 := a, IN2 := b, IN3 := c", "INT"), ("MIN", "IN1 := x, IN2 := 1.5", "REAL"),
    ("LIMIT", "MN := b, IN := a, MX := c", "INT"),
    ("MUX", "K := i, IN0 := a, IN1 := b, IN2 := c", "INT"),
    ("GT", "IN1 := b, IN2 := a", "BOOL"), ("ADD", "IN1 := a, IN2 := b, IN3 := 1", "INT"),
    ("LEN", "IN := s", "INT"), ("LEFT", "IN := s, L := 2", "STRING"),
    ("MID", "IN := s, L := 1, P := 2", "STRING"), ("CONCAT", "IN1 := s, IN2 := 'd'", "STRING"),
    ("REPLACE", "IN1 := s, IN2 := 'xy', L := 1, P := 2", "STRING"),
    ("FIND", "IN1 := s, IN2 := 'c'", "INT"), ("INT_TO_DINT", "a", "DINT"),
    ("INT_TO_STRING", "a", "STRING"), ("REAL_TO_INT", "x", "INT"), ("WORD_TO_UINT", "w", "UINT"),
    ("TIME_TO_DINT", "t", "DINT"), ("MOVE", "a", "INT"), ("TRUNC", "x", "DINT"),
]


@pytest.mark.parametrize(("name", "arguments", "of"), STANDARD)
def test_standard_functions_give_in_il_in_both_forms_what_they_give_in_st(name, arguments, of):
    operands = [each.split(":=")[-1].strip() for each in arguments.split(", ")]
    informal = f"LD {operands[0]}\n{name} {', '.join(operands[1:])}"
    formal = f"{name}(\n" + arguments.replace(", ", ",\n") + "\n)"
    il = f"{informal}\nST one\n{formal}\nST two"
    expected = evaluate(VARIABLES + f"one : {of};", f"one := {name}({arguments});", "one")
    controller = Controller(main(VARIABLES + f"one, two : {of};", il)).scan()
    assert (controller["one"], controller["two"]) == (expected, expected)


def test_strings_are_current_results():
    controller = Controller(main(VARIABLES, "LD s\nST u\nLD u\nEQ 'abc'\nST q"))
    assert controller.scan()["q"]


SCALE = """
FUNCTION scale : INT
VAR_INPUT value : INT; factor : INT := 2; END_VAR
VAR_OUTPUT doubled : BOOL; END_VAR
LD value
MUL factor
ST scale
LD factor
EQ 2
ST doubled
LD value
GE 0
RETC
LD 0
ST scale
END_FUNCTION
"""


@pytest.mark.parametrize(("text", "name", "expected"), [
    ("LD b\nscale 4\nST n", "n", 12),
    ("scale(value := b)\nST n", "n", 6),
    ("scale(\nvalue := b,\ndoubled => q\n)\nST n", "q", True),
    ("scale(\nvalue := b,\nNOT doubled => q\n)\nST n", "q", False),
    ("LD a\nscale 4\nST n", "n", 0),
    ("LD b\nSCALE 1\nSCALE 5\nST n", "n", 15),
    ("LD b\nscale 2\nGT b\nST q", "q", True),
])
def test_a_function_in_il_returns_the_variable_of_its_name(text, name, expected):
    controller = Controller(main(VARIABLES, text) + SCALE)
    assert controller.scan()[name] == expected


@pytest.mark.parametrize("text", [
    "CAL cnt(CU := p, R := q, PV := 2)",
    "CAL cnt(\n  CU := p,\n  R := q,\n  PV := 2\n)",
    "CAL cnt(p, q, 2)",
    "CAL cnt(p, FALSE, 2, z, n)",
    "LD p\nST cnt.CU\nLD 2\nST cnt.PV\nCAL cnt",
    "LD 2\nPV cnt\nLD p\nCU cnt",
    "LDN q\nCALC cnt(CU := p, PV := 2)",
    "LD q\nCALCN cnt(CU := p, PV := 2)",
    "CAL cnt(CU := (\nLD p\nANDN q\n), PV := 2)",
])
def test_a_function_block_is_called_in_every_form(text):
    controller = Controller(main(VARIABLES + "cnt : CTU;", f"{text}\nLD cnt.CV\nST n"))
    assert controller.scan(3)["n"] == 1
    controller["p"] = False
    controller.scan()
    controller["p"] = True
    assert controller.scan()["n"] == 2
    assert controller["cnt.Q"]


def test_outputs_of_a_call_go_into_variables_negated_ones_too():
    text = "CAL cnt(CU := p, PV := 1, Q => q, NOT Q => z, CV => n)"
    controller = Controller(main(VARIABLES + "cnt : CTU;", text)).scan()
    assert (controller["q"], controller["z"], controller["n"]) == (True, False, 1)


def test_call_operators_give_the_current_result_to_an_input_and_call():
    text = "LD z\nR cnt\nLD p\nCU cnt\nLD p\nCD down\nLD 5\nPV down\nLD q\nLD down"
    controller = Controller(main(VARIABLES + "cnt : CTU; down : CTD;", text)).scan()
    assert (controller["cnt.CV"], controller["down.CV"]) == (1, -1)
    controller["z"] = controller["q"] = True
    controller["p"] = False
    controller.scan()
    assert (controller["cnt.CV"], controller["down.CV"]) == (0, 5)


@pytest.mark.parametrize(("block", "text", "output"), [
    ("SR", "LD p\nS1 fb\nLD q\nR fb", "Q1"),
    ("RS", "LD p\nS fb\nLD q\nR1 fb", "Q1"),
    ("R_TRIG", "LD p\nCLK fb", "Q"),
    ("TP", "LD t\nPT fb\nLD p\nIN fb", "Q"),
    ("TOF", "LD t\nPT fb\nLD p\nIN fb", "Q"),
])
def test_every_standard_block_has_its_call_operators(block, text, output):
    controller = Controller(main(VARIABLES + f"fb : {block};", text)).scan()
    assert controller[f"fb.{output}"]


def test_a_timer_runs_by_its_call_operators():
    text = "LD T#30ms\nPT fb\nLD p\nIN fb\nLD fb.Q\nST q"
    controller = Controller(main(VARIABLES + "fb : TON;", text))
    assert controller.lines(6, ["q"]) == {"q": "___---"}


def test_the_current_result_stays_over_a_call_operator():
    controller = Controller(main(VARIABLES + "fb : R_TRIG;", "LD p\nCLK fb\nST q"))
    assert controller.scan()["q"]


def test_elements_of_arrays_and_structures_are_operands():
    text = ("TYPE pair : STRUCT one : INT := 4; two : ARRAY[1..2] OF BOOL; END_STRUCT END_TYPE\n"
            "TYPE colour : (RED, GREEN, BLUE); END_TYPE\n"
            + main(VARIABLES + "k : pair; o AT %QX0.0 : BOOL; e : colour; m : ARRAY[1..2] OF CTU;",
                   "LD k.one\nADD 1\nST k.one\nLD p\nS k.two[2]\nLD k.two[2]\nST %QX0.0\n"
                   "LD GREEN\nST e\nLD e\nEQ colour#GREEN\nST q\nLD p\nCU m[b]\nLD m[2].CV\nST n"))
    controller = Controller(text)
    controller["b"] = 2
    controller.scan()
    assert (controller["k.one"], controller["o"], controller["q"], controller["n"]) == \
        (5, True, True, 1)


@pytest.mark.parametrize(("text", "hint"), [
    ("LD a\nABSS\nST n", "ABS"), ("LD a\nLIMITT 1, 2\nST n", "LIMIT"),
    ("LD a\nscall 4\nST n", "SCALE"), ("LD a\nSTT n", "ST"),
])
def test_an_unknown_operator_is_diagnosed_with_the_nearest_one_or_function(text, hint):
    with pytest.raises(CompileError) as caught:
        compile_program(main(VARIABLES, text) + SCALE)
    assert [d.code for d in caught.value.diagnostics] == ["P0012"]
    assert hint in caught.value.diagnostics[0].hint


@pytest.mark.parametrize(("text", "expected"), [
    ("ABS\nST n", ["5:1: P0042"]),
    ("LD a\nMAX b, p\nST n", ["6:8: P0023"]),
    ("LD a\nABS b\nST n", ["6:1: P0026"]),
    ("LD p\nS1 a", ["6:4: P0026"]),
    ("LD p\nCLK cnt", ["6:1: P0026"]),
    ("LD p\nCU 5", ["6:4: P0013"]),
    ("LD p\nAND(\nLD q\nCU cnt\n)\nST z", ["8:1: P0013"]),
    ("LIMIT(\nMN := 1,\nIN := c\nST n", ["8:1: P0011"]),
    ("CAL cnt(CU := p, FOO := 2)", ["5:18: P0026"]),
])
def test_mistakes_in_calls_are_diagnosed(text, expected):
    text = main(VARIABLES + "cnt : CTU;", text)
    assert [f for f in findings(text) if "P007" not in f] == expected


def test_a_body_that_begins_with_a_call_is_il_without_and_st_with_a_semicolon():
    il = main(VARIABLES, "LIMIT(MN := 1, IN := c, MX := 10)\nST n")
    st = main(VARIABLES, "scale(value := 5);\nn := 3;") + SCALE
    assert (Controller(il).scan()["n"], Controller(st).scan()["n"]) == (10, 3)
