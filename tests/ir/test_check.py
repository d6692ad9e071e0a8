"""The rules of the IR: good code passes, every kind of bad code is found with its place."""

from pathlib import Path

import pytest

from plcemu.ir.check import IrInvalid, check_function
from plcemu.ir.program import Function, Instr
from plcemu.lang.compile import compile_program

I5 = Instr("const", ("i16", 5))
TRUE = Instr("const", ("bool", True))
RET = Instr("ret")


def check(*code, locals_=("i16",), result=""):
    function = Function("F", code, locals_, result)
    value = Function("V", (I5, RET), (), "i16")
    check_function(function, {"F": function, "V": value})


@pytest.mark.parametrize("code", [
    (RET,), (I5, Instr("set", 0), RET), (Instr("get", 0), Instr("drop"), RET),
    (I5, I5, Instr("add.i16"), Instr("store", ("i16", "this", 0)), RET),
    (TRUE, Instr("jumpif", 1), Instr("label", 1), RET), (Instr("fault", "no"),),
    (Instr("addr", ("memory", 0)), Instr("call", "V"), Instr("drop"), RET),
    (Instr("jump", 1), Instr("nonsense"), Instr("label", 1), RET),
])
def test_good_code_passes(code):
    check(*code)


def test_a_result_must_be_on_the_stack_at_the_return():
    check(I5, RET, result="i16")
    with pytest.raises(IrInvalid, match="declared 'i16'"):
        check(RET, result="i16")


@pytest.mark.parametrize(("code", "message"), [
    ((), "runs off its end"), ((I5,), "runs off its end"), ((I5, RET), "returns"),
    ((Instr("add.i16"), RET), "is empty"), ((I5, TRUE, Instr("add.i16"), RET), "expected i16"),
    ((I5, Instr("not.bool"), RET), "expected bool"), ((Instr("drop"), RET), r"F\[0\] drop"),
    ((Instr("nonsense"), RET), "no such operation"), ((Instr("add.i17"), RET), "no such operation"),
    ((Instr("jump", 7), RET), "no such label"), ((TRUE, Instr("jumpif", 7), RET), "no such label"),
    ((Instr("label", 1), Instr("label", 1), RET), "a label stands twice"),
    ((I5, Instr("label", 1), Instr("drop"), RET), "the stack holds"),
    ((I5, Instr("jump", 1), Instr("label", 1), RET), "the stack holds"),
    ((Instr("get", 5), RET), r"F\[0\] get 5"), ((TRUE, Instr("set", 0), RET), "expected i16"),
    ((Instr("addr", ("memory", 0)), Instr("call", "X"), RET), "'X'"),
    ((I5, Instr("call", "V"), RET), "u32"),
    ((Instr("const", ("i16", 40000)), Instr("drop"), RET), "no value"),
    ((Instr("const", ("f32", 0.1)), Instr("drop"), RET), "no value"),
    ((Instr("const", ("i99", 1)), Instr("drop"), RET), "no value"),
    ((Instr("const", ("bool", 2)), Instr("drop"), RET), "no value"),
    ((Instr("load", ("i16", "nowhere", 0)), Instr("drop"), RET), "no place"),
    ((Instr("load", ("i17", "this", 0)), Instr("drop"), RET), "load"),
    ((Instr("addr", ("this", -1)), Instr("drop"), RET), "no place"),
])
def test_bad_code_is_found(code, message):
    with pytest.raises(IrInvalid, match=message):
        check(*code)


def test_a_hundred_thousand_instructions_are_checked_in_one_pass():
    code = [part for n in range(25_000) for part in (Instr("label", n), TRUE, Instr("jumpif", n))]
    check(*code, RET)


def test_the_programs_that_come_with_the_product_keep_the_rules():
    for path in (Path(__file__).parents[2] / "il_programs").glob("*/*.sfc"):
        program = compile_program(path)
        for function in program.functions.values():
            check_function(function, program.functions)
