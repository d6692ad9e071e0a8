"""Instruction List: every operator, modifier and form (IEC 61131-3, tables 52 and 53)."""

import struct

import pytest
from controller import Controller, evaluate, findings, main
from hypothesis import given
from hypothesis import strategies as st

from plcemu.base.errors import CompileError
from plcemu.lang.compile import compile_program

BITS = "a, b, x, y : BOOL;"


@pytest.mark.parametrize(("body", "table"), [
    ("LD a\nST x", "__--"), ("LDN a\nST x", "--__"), ("LD a\nSTN x", "--__"),
    ("LD a\nAND b\nST x", "___-"), ("LD a\nANDN b\nST x", "__-_"),
    ("LD a\n& b\nST x", "___-"), ("LD a\n&N b\nST x", "__-_"),
    ("LD a\nOR b\nST x", "_---"), ("LD a\nORN b\nST x", "-_--"),
    ("LD a\nXOR b\nST x", "_--_"), ("LD a\nXORN b\nST x", "-__-"),
    ("LD a\nNOT\nAND b\nST x", "_-__"), ("LDN a\nNOT\nST x", "__--"),
    ("LD a\nAND(\nLD b\nOR a\n)\nST x", "__--"), ("LD a\nAND( b\nOR a\n)\nST x", "__--"),
    ("LD a\nANDN( b\n)\nST x", "__-_"), ("LD a\nORN( b\n)\nST x", "-_--"),
    ("LD a\nXORN( b\n)\nST x", "-__-"), ("LD a\nXOR(b)\nST x", "_--_"),
    ("LD a\nOR( a\nAND( b\nXOR a\n)\n)\nST x", "__--"),
    ("LD a\nAND(\nLDN b\nAND(\nLD a\nNOT\nXOR TRUE\n)\n)\nST x", "__-_"),
    ("LD a\nAND( b\nST y\n)\nST x", "___-"), ("LD TRUE\nAND a\nST x", "__--"),
    ("LD FALSE\nOR b\nST x", "_-_-"), ("LD 1\nAND b\nST x", "_-_-"),
    ("LD 0\nST x", "____"), ("LD TRUE\nNOT\nST x", "____"), ("LDN TRUE\nST x", "____"),
    ("LD BOOL#1\nST x", "----"), ("LD 1\nSTN x", "____"), ("LD 1\nAND( a\n)\nST x", "__--"),
    ("LD a\nEQ b\nST x", "-__-"), ("LD a\nNE b\nST x", "_--_"),
    ("LD a ; AND b ; ST x", "___-"), ("ld A\nand B\nst X", "___-"),
    ("start: LD a\nST x", "__--"), ("(* text *) LD a // text\nST x", "__--"),
])
def test_a_boolean_body_has_its_truth_table(body, table):
    found = "".join("-" if evaluate(BITS, body, "x", a=a, b=b) else "_"
                    for a in (False, True) for b in (False, True))
    assert found == table


@pytest.mark.parametrize(("body", "before", "after"), [
    ("LD a\nS x", "__", "_-"), ("LD a\nR x", "--", "-_"),
    ("LD a\nS x\nS y", "__", "_-"), ("LD TRUE\nS x", "_-", "--"), ("LD 0\nR x", "_-", "_-"),
])
def test_set_and_reset_act_only_on_true(body, before, after):
    found = ""
    for a, level in zip((False, True), before, strict=True):
        found += "-" if evaluate(BITS, body, "x", a=a, x=level == "-") else "_"
    assert found == after


@pytest.mark.parametrize(("body", "expected"), [
    ("LD 7\nADD 5\nST i", 12), ("LD 7\nSUB 9\nST i", -2), ("LD 7\nMUL -3\nST i", -21),
    ("LD -7\nDIV 2\nST i", -3), ("LD -7\nMOD 2\nST i", -1), ("LD 7\nMOD -2\nST i", 1),
    ("LD 32767\nADD 1\nST i", -32768), ("LD -32768\nDIV -1\nST i", -32768),
    ("LD i\nADD( 2\nMUL 5\n)\nST i", 13), ("LD 10\nSUB( i\nADD i\n)\nST i", 4),
    ("LD 2\nMUL( 3\n)\nST i", 6), ("LD 16#7F\nST i", 127), ("LD 2#1010_1010\nST i", 170),
    ("LD 8#17\nST i", 15), ("LD INT#16#FF\nST i", 255), ("LD INT#-5\nST i", -5),
    ("LD - 5\nST i", -5), ("LD +5\nST i", 5), ("LD 1_000\nST i", 1000),
])
def test_integer_arithmetic_wraps_and_truncates(body, expected):
    assert evaluate("i : INT := 3;", body, "i") == expected


@pytest.mark.parametrize(("left", "right", "table"), [
    (1, 2, {"LT", "LE", "NE"}), (2, 2, {"EQ", "LE", "GE"}), (3, 2, {"GT", "GE", "NE"}),
    (-1, 1, {"LT", "LE", "NE"})])
def test_comparisons(left, right, table):
    found = {op for op in ("GT", "GE", "EQ", "NE", "LE", "LT")
             if evaluate("i, k : INT; x : BOOL;", f"LD i\n{op} k\nST x", "x", i=left, k=right)
             and evaluate("i, k : INT; x : BOOL;", f"LD i\n{op}(\nLD k\n)\nST x", "x", i=left,
                          k=right)}
    assert found == table


@pytest.mark.parametrize(("declared", "body", "name", "expected"), [
    ("i : INT := 300; d : DINT;", "LD i\nST d", "d", 300),
    ("i : INT := 300; d : DINT := 100000;", "LD i\nADD d\nST d", "d", 100300),
    ("i : INT := 300; d : DINT := 100000;", "LD d\nADD i\nST d", "d", 100300),
    ("i : INT := 300; d : DINT := 100000;", "LD i\nADD( d\n)\nST d", "d", 100300),
    ("i : INT := 3; r : REAL := 0.5;", "LD i\nADD r\nST r", "r", 3.5),
    ("i : INT := 3; r : REAL := 0.5;", "LD r\nMUL( i\n)\nST r", "r", 1.5),
    ("r : REAL := 0.5; l : LREAL;", "LD r\nST l", "l", 0.5),
    ("u : USINT := 250; i : INT;", "LD u\nADD i\nST i", "i", 250),
    ("u : UINT := 60000; i : INT := -1; d : DINT;", "LD u\nADD i\nST d", "d", 59999),
    ("d : DINT;", "LD 70000\nADD 1\nST d", "d", 70001),
    ("d : DINT;", "LD 70000\nADD( 1\n)\nST d", "d", 70001),
    ("d : DINT := 5;", "LD 70000\nADD( d\n)\nST d", "d", 70005),
    ("w : WORD := 16#F0F0;", "LD w\nAND 16#FF00\nST w", "w", 0xF000),
    ("w : WORD := 16#F0F0;", "LD 16#FF00\nAND( w\n)\nST w", "w", 0xF000),
    ("w : WORD := 16#F0F0;", "LD w\nNOT\nST w", "w", 0x0F0F),
    ("w : WORD := 16#F0F0;", "LD w\nSTN w", "w", 0x0F0F),
    ("w : WORD := 16#F0F0;", "LD w\nXORN w\nST w", "w", 0xFFFF),
    ("b : BYTE := 16#81; w : WORD;", "LD b\nST w", "w", 0x81),
    ("i : INT; r : REAL;", "LD 5\nST i\nST r", "r", 5.0),
    ("r : REAL;", "LD 1.5\nADD 1\nST r", "r", 2.5), ("r : REAL;", "LD 1\nADD 1.5\nST r", "r", 2.5),
    ("t : TIME := T#2s;", "LD t\nMUL 3\nST t", "t", 6_000_000_000),
    ("t : TIME := T#2s;", "LD t\nMUL( 3\n)\nST t", "t", 6_000_000_000),
    ("t : TIME := T#2s; i : INT := 4;", "LD t\nDIV i\nST t", "t", 500_000_000),
    ("t : TIME := T#2s; i : INT := 4;", "LD t\nDIV( i\n)\nST t", "t", 500_000_000),
    ("t : TIME := T#2s;", "LD t\nADD T#1m\nSUB T#500ms\nST t", "t", 61_500_000_000),
    ("t : LTIME := T#2s;", "LD t\nMUL 3\nST t", "t", 6_000_000_000),
    ("r : REAL; x : BOOL;", "LD 0.1\nST r\nLD r\nEQ 0.1\nST x", "x", True),
    ("r : REAL := 16777216.0;", "LD r\nADD 1.0\nST r", "r", 16777216.0),
    ("u : ULINT;", "LD 18446744073709551615\nST u", "u", 2**64 - 1),
])
def test_types_widen_and_literals_take_the_type_around_them(declared, body, name, expected):
    assert evaluate(declared, body, name) == expected


INTEGERS = {"SINT": 8, "INT": 16, "DINT": 32, "LINT": 64}


def wrapped(value, bits):
    return (value + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)


def exact(op, a, b):
    quotient = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1) if b else 0
    return {"ADD": a + b, "SUB": a - b, "MUL": a * b, "DIV": quotient, "MOD": a - b * quotient}[op]


@given(st.sampled_from(sorted(INTEGERS)), st.integers(), st.lists(st.tuples(
    st.sampled_from(["ADD", "SUB", "MUL", "DIV", "MOD"]),
    st.integers().filter(bool)), min_size=1, max_size=6))
def test_random_integer_chains_wrap_like_machine_integers(name, first, chain):
    bits = INTEGERS[name]
    operands = [wrapped(value, bits) or 1 for _, value in chain]
    expected = first = wrapped(first, bits)
    body = [f"LD {name}#{first}"]
    for (op, _), operand in zip(chain, operands, strict=True):
        expected = wrapped(exact(op, expected, operand), bits)
        body.append(f"{op} {name}#{operand}")
    assert evaluate(f"i : {name};", "\n".join([*body, "ST i"]), "i") == expected


def single(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


moderate = st.floats(-1e6, 1e6, width=32).filter(lambda v: v == 0 or abs(v) > 1e-6)
REAL_OPS = {"ADD": lambda a, b: a + b, "SUB": lambda a, b: a - b, "MUL": lambda a, b: a * b}


@given(moderate, st.lists(st.tuples(st.sampled_from(sorted(REAL_OPS)), moderate), max_size=4))
def test_random_real_chains_round_to_single_precision_after_every_operation(first, chain):
    expected = first
    for op, operand in chain:
        expected = single(REAL_OPS[op](expected, operand))
    names = ", ".join(f"r{n}" for n in range(len(chain) + 1))
    body = ["LD r0", *(f"{op} r{n}" for n, (op, _) in enumerate(chain, 1)), "ST x"]
    values = {f"r{n}": v for n, v in enumerate([first, *(v for _, v in chain)])}
    assert evaluate(f"{names}, x : REAL;", "\n".join(body), "x", **values) == expected


# ---------------------------------------------------------------- jumps


def test_a_jump_backwards_makes_a_loop():
    body = "again: LD i\nADD 1\nST i\nLT 10\nJMPC again"
    assert evaluate("i : INT;", body, "i") == 10


def test_a_jump_backwards_with_a_live_result_carries_it():
    body = "LD 0\nagain: ADD 3\nST i\nLD i\nLT 10\nJMPCN done\nLD i\nJMP again\ndone:"
    assert evaluate("i : INT;", body, "i") == 12


def test_a_result_lives_across_a_label_reached_on_two_ways():
    body = "LD a\nJMPC there\nLD b\nthere: ST x"
    table = [evaluate(BITS, body, "x", a=a, b=b) for a in (False, True) for b in (False, True)]
    assert table == [False, True, True, True]


def test_the_result_stays_after_jmpc_falls_through():
    assert evaluate("a : BOOL; x : BOOL := TRUE;", "LD a\nJMPC far\nST x\nfar:", "x") is False


def test_jmpcn_jumps_on_false():
    assert evaluate("i : INT; a : BOOL;", "LD a\nJMPCN far\nLD 5\nST i\nfar: LD 0", "i") == 0


def test_a_block_entered_only_by_a_jump_back_knows_its_result():
    body = "JMP start\nback: ADD 1\nST i\nRET\nstart: LD 5\nJMP back"
    assert evaluate("i : INT;", body, "i") == 6


def test_jumps_without_a_result_are_no_mistake_where_none_is_wanted():
    body = "JMP one\ntwo: LD 7\nST i\nRET\none: JMP two"
    assert evaluate("i : INT;", body, "i") == 7


def test_a_jump_to_a_return_needs_no_result():
    assert evaluate("i : INT := 4;", "JMP done\nLD 0\nST i\ndone: RET", "i") == 4


def test_a_call_between_a_label_and_its_use_keeps_the_result():
    body = "LD a\nJMPC l\nl: CAL t(CLK := b)\nST x"
    assert evaluate(BITS + "t : R_TRIG;", body, "x", a=True) is True


@pytest.mark.parametrize(("op", "table"), [("RETC", "-_"), ("RETCN", "_-")])
def test_conditional_returns(op, table):
    body = f"LD a\n{op}\nLD FALSE\nST x"
    found = "".join("-" if evaluate("a : BOOL; x : BOOL := TRUE;", body, "x", a=a) else "_"
                    for a in (True, False))
    assert found == table


def test_ret_ends_the_body():
    assert evaluate("i : INT;", "LD 1\nST i\nRET\nLD 2\nST i", "i") == 1


def test_the_result_stays_after_retc_falls_through():
    assert evaluate("a, x : BOOL;", "LD a\nRETC\nSTN x", "x") is True


def test_labels_are_case_insensitive_and_may_stand_alone_at_the_end():
    assert evaluate("i : INT;", "LD 1\nST i\nJMP THE_END\nLD 2\nST i\nthe_end:", "i") == 1


def test_an_endless_loop_is_a_fault_of_the_program():
    controller = Controller(main("i : INT;", "l: JMP l"), budget=10_000).scan()
    assert "does not end" in controller.resource.fault.reason


# ---------------------------------------------------------------- calls

COUNTER = "c : CTU; go, q : BOOL; n : INT;"


@pytest.mark.parametrize("call", [
    "CAL c(CU := go, R := FALSE, PV := 2)", "CAL c(go, FALSE, 2)", "CAL c(go)\n",
    "CAL c(\n  CU := go,\n  PV := 2\n)", "CAL c (\n  CU := go\n  )", "CAL c(PV := 2, CU := go)",
    "LD go\nST c.CU\nCAL c", "LD go\nST c.CU\nCAL c()", "cal C(cu := GO)",
    "LD TRUE\nCALC c(CU := go)", "LD FALSE\nCALCN c(CU := go)",
    "LD TRUE\nCALC c(\nCU := go\n)\n",
])
def test_every_form_of_call_counts_an_edge(call):
    controller = Controller(main(COUNTER, f"{call}\nLD c.CV\nST n"))
    controller.scan()
    controller["go"] = True
    assert controller.scan(2)["n"] == 1


@pytest.mark.parametrize(("call", "expected"), [
    ("CALC c(CU := go)", 0), ("CALCN c(CU := go)", 1)])
def test_conditional_calls_follow_the_current_result(call, expected):
    controller = Controller(main(COUNTER, f"LD q\n{call}\nLD c.CV\nST n"))
    controller["go"] = True
    assert controller.scan()["n"] == expected


def test_output_arguments_of_a_call_are_stored():
    body = "CAL c(CU := go, PV := 1, Q => q, CV => n)"
    controller = Controller(main(COUNTER, body))
    controller["go"] = True
    controller.scan()
    assert (controller["q"], controller["n"]) == (True, 1)


def test_a_negated_output_argument_is_inverted():
    assert evaluate(COUNTER, "CAL c(PV := 1, NOT Q => q)", "q") is True


def test_an_output_argument_widens():
    declared = "c : CTU; go : BOOL := TRUE; d : DINT;"
    assert evaluate(declared, "CAL c(CU := go, CV => d)", "d") == 1


def test_parameters_named_like_operators_are_no_operators():
    body = "LD TRUE\nST r.S\nCAL r(\n  S := TRUE,\n  R1 := FALSE\n)\nLD r.Q1\nST x"
    assert evaluate("r : RS; x : BOOL;", body, "x") is True


def test_the_result_stays_over_a_call():
    assert evaluate(COUNTER, "LD TRUE\nCAL c(CU := go)\nST q", "q") is True


def test_variables_named_like_operators_can_be_operands():
    assert evaluate("s, r, n : BOOL;", "LD TRUE\nST s\nLD s\nS r", "r") is True


def test_function_blocks_of_the_user_are_called_and_keep_their_values():
    text = ("FUNCTION_BLOCK Twice VAR_INPUT i : INT; END_VAR VAR_OUTPUT o : INT; END_VAR\n"
            "VAR calls : INT; END_VAR\nLD i\nMUL 2\nADD calls\nST o\nLD calls\nADD 1\nST calls\n"
            "END_FUNCTION_BLOCK\n" + main("f : twice; n : INT;", "CAL f(i := 10, o => n)"))
    assert Controller(text).values(3, "n") == [20, 21, 22]


# ---------------------------------------------------------------- direct addresses


def test_direct_addresses_are_read_and_written():
    controller = Controller(main("", "LD %IX0.1\nANDN %I0.2\nST %QX1.0\nLD %IW3\nST %QW0"))
    controller["%IX0.1"] = True
    controller["%IW3"] = 0xBEEF
    controller.scan()
    assert (controller["%QX1.0"], controller["%QW0"]) == (True, 0xBEEF)


def test_an_address_declared_without_a_name_has_the_declared_type():
    controller = Controller(main("AT %IW0 : INT;", "LD %IW0\nADD -1\nST %iw0"))
    assert controller.scan()["%IW0"] == -1


def test_two_programs_may_declare_the_same_address():
    part = "VAR AT %QX0.0 : BOOL; END_VAR LD TRUE\nST %QX0.0\n"
    text = f"PROGRAM one {part}END_PROGRAM PROGRAM two {part}END_PROGRAM"
    assert Controller(text).scan()["%QX0.0"] is True


# ---------------------------------------------------------------- size


def test_a_body_of_ten_thousand_instructions_with_labels_compiles():
    body = "\n".join(f"l{n}: LD a\nAND b\nJMPC l{n + 1}\nST x" for n in range(2500))
    assert findings(main(BITS.replace(", y", ""), body + "\nl2500:")) == []


def test_the_current_result_must_be_defined_on_every_way():
    with pytest.raises(CompileError, match="P0042"):
        compile_program(main("a : BOOL;", "AND a\nST a"))
