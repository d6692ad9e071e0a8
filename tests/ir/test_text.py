"""The IR's text form reads back to the same code."""

from pathlib import Path

import pytest
from controller import main

from plcemu.ir.program import Function, Instr
from plcemu.ir.text import IrTextError, digest, parse_functions, print_function, print_program
from plcemu.lang.compile import compile_program

PROGRAMS = sorted((Path(__file__).parents[2] / "il_programs").glob("*/*.sfc"))
LIBRARY = main("t : TON; u : TOF; v : TP; a : CTUD; b : SR; c : F_TRIG; l : LREAL; r : REAL;"
               "x : BOOL;",
               "t(); u(); v(); a(); b(); c(); l := 1.0E-300; r := -0.1; x := NOT x;")


def code(functions):
    return {f.name: (f.locals, f.result, f.pou, [(i.op, i.arg) for i in f.code])
            for f in functions.values()}


@pytest.mark.parametrize("source", [*PROGRAMS, LIBRARY])
def test_a_program_reads_back_from_its_text(source):
    program = compile_program(source)
    again = parse_functions(print_program(program))
    assert code(again) == code(program.functions)
    assert "\n".join(map(print_function, again.values())) == "\n".join(
        print_function(f) for f in parse_functions("\n".join(map(print_function,
                                                                 again.values()))).values())


def test_every_kind_of_instruction_reads_back():
    function = Function("F'", (
        Instr("const", ("f64", float("inf"))), Instr("drop"), Instr("const", ("f32", -0.0)),
        Instr("set", 0), Instr("const", ("bool", True)), Instr("jumpifnot", 1),
        Instr("addr", ("this", 8)),
        Instr("call", "G"), Instr("drop"), Instr("load", ("i16", "memory", 4)),
        Instr("store", ("i16", "this", 0)), Instr("jump", 1), Instr("label", 1),
        Instr("fault", 'a "quoted" reason    ; ü')), ("f32", "bool"), "", "F")
    assert code(parse_functions(print_function(function))) == code({"F'": function})


@pytest.mark.parametrize("text", [
    "hello", "function F", "function F () -> -", "function F () -> - of F\n  ret",
    "function F () -> - of F\n  hello\nend", "function F () -> - of F\n  const.i99 5\nend",
    "function F () -> - of F\n  const.i16 x\nend",
    "function F () -> - of F\n  load.i16 nowhere+4\nend",
    "function F () -> - of F\n  get\nend", "function F () -> - of F\n  fault x\nend",
    "function F () -> - of F\nLx:\nend", "function F () -> - of F\n  add.i17\nend"])
def test_a_text_that_is_no_ir_is_refused_with_its_line(text):
    with pytest.raises(IrTextError, match=r"^line [12]: "):
        parse_functions(text)


def test_the_text_names_the_lines_of_the_source():
    assert "; <text>:5" in print_program(compile_program(main("x : BOOL;", "x := TRUE;")))


def test_equal_programs_have_equal_digests_and_others_do_not():
    one, same, other = (compile_program(main("x : BOOL;", f"x := {v};")) for v in ("x", "x",
                                                                                   "NOT x"))
    initial = compile_program(main("x : BOOL := 1;", "x := x;"))
    assert digest(one) == digest(same)
    assert len({digest(one), digest(other), digest(initial)}) == 3
