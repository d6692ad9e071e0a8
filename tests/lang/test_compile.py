"""The compiler's front door: texts, files, tags, layout, limits and time."""

import time
from itertools import pairwise
from pathlib import Path

import pytest
from controller import Controller, findings, main

from plcemu.base.errors import CompileError
from plcemu.ir.text import digest
from plcemu.lang.compile import compile_program

ONE = main("x : BOOL;", "x := NOT x;")
BLOCK = ("FUNCTION_BLOCK B VAR_INPUT i : BOOL; END_VAR VAR_OUTPUT o : BOOL; END_VAR o := i;\n"
         "END_FUNCTION_BLOCK\n")
USER = "PROGRAM USES VAR b : B; END_VAR b(i := TRUE); END_PROGRAM\n"


def test_a_text_a_path_and_lists_of_them_compile(tmp_path):
    one, two = tmp_path / "one.st", tmp_path / "two.st"
    one.write_text(BLOCK, "utf-8")
    two.write_text(USER, "utf-8")
    assert [i.name for i in compile_program(ONE).instances] == ["MAIN"]
    assert [i.name for i in compile_program([two, one]).instances] == ["USES"]
    assert [i.name for i in compile_program([ONE, one, two]).instances] == ["MAIN", "USES"]
    assert [i.name for i in compile_program(iter([BLOCK + USER])).instances] == ["USES"]


def test_line_ends_and_a_byte_order_mark_do_not_matter(tmp_path):
    path = tmp_path / "windows.st"
    path.write_bytes(b"\xef\xbb\xbf" + ONE.replace("\n", "\r\n").encode())
    assert digest(compile_program(path)).isalnum()
    assert len(compile_program("\ufeff" + ONE).functions) == 1


@pytest.mark.parametrize("source",
                         ["", "   \n", "(* only a comment *)", "// only a comment", [], [""]])
def test_a_text_without_a_program_is_diagnosed_at_its_begin(source):
    with pytest.raises(CompileError) as caught:
        compile_program(source)
    assert str(caught.value).startswith("<text>:1:1: P0061")


@pytest.mark.parametrize("path", ["no/such/file.st", ".", "bad\0name"])
def test_a_path_that_is_no_readable_file_is_diagnosed(path):
    with pytest.raises(CompileError) as caught:
        compile_program(Path(path))
    assert [d.code for d in caught.value.diagnostics] == ["P0080"]


def test_the_same_text_gives_the_same_program():
    assert digest(compile_program(BLOCK + USER)) == digest(compile_program(BLOCK + USER))


def test_function_blocks_may_stand_behind_their_use():
    assert Controller(USER + BLOCK).scan()["b.o"] is True


def test_unused_functions_are_left_out():
    assert list(compile_program(BLOCK + ONE).functions) == ["MAIN"]


def test_warnings_do_not_stop_the_compilation():
    program = compile_program(main("x, y : BOOL;", "x := TRUE;"))
    assert [str(w) for w in program.warnings] == [
        "<text>:3:4: P0070 warning: variable 'y' is never used"]


# ---------------------------------------------------------------- tags and layout


def tags(text):
    return [(t.name, t.type, t.unit, t.address) for t in Controller(text).resource.memory.tags]


def test_every_variable_step_and_field_of_a_block_is_a_tag():
    text = main("q AT %QX0.1 : BOOL; t : TON; my__var : INT;",
                "INITIAL_STEP A: q(SD, T#1s); END_STEP\n"
                "ACTION b: t(); my__var := 1; END_ACTION")
    assert tags(text) == [
        ("MAIN.q", "BOOL", "", "%QX0.1"), ("MAIN.t.IN", "BOOL", "", ""),
        ("MAIN.t.PT", "TIME", "ns", ""),
        ("MAIN.t.Q", "BOOL", "", ""), ("MAIN.t.ET", "TIME", "ns", ""),
        ("MAIN.my__var", "INT", "", ""),
        ("MAIN.A.T", "TIME", "ns", ""), ("MAIN.A.X", "BOOL", "", "")]


def test_addresses_without_a_variable_are_tags_of_their_own():
    assert tags(main("q AT %QX0.0 : BOOL;", "q := %IX0.1 AND %QX0.0; %MW3 := %IW2;")) == [
        ("MAIN.q", "BOOL", "", "%QX0.0"), ("%IW2", "WORD", "", "%IW2"),
        ("%IX0.1", "BOOL", "", "%IX0.1"),
        ("%MW3", "WORD", "", "%MW3")]


def test_the_image_stands_in_whole_bytes_and_near_addresses_share_a_stretch():
    program = compile_program(main("", "%QX0.3 := %QX2.1; %QX900.0 := %IX5.5; %QD7 := %QD9;"))
    assert [(e.area, e.first, e.count) for e in program.layout.extents] == [
        ("IX", 40, 8), ("QD", 7, 3), ("QX", 0, 24), ("QX", 7200, 8)]
    assert all(e.offset % {"X": 1, "D": 4}[e.area[1]] == 0 for e in program.layout.extents)


def test_values_are_aligned_and_do_not_overlap():
    text = main("a : BOOL; b : LREAL; c : SINT; d : DINT; e : BOOL; f : INT; t : TON;", "t();a:=e;")
    memory = Controller(text).resource.memory
    places = sorted((memory.place(i)[0], memory.place(i)[1].size) for i in range(len(memory.tags)))
    assert all(offset % size == 0 for offset, size in places)
    assert all(a + size <= b for (a, size), (b, _) in pairwise(places))


def test_initial_values_stand_in_the_layout():
    text = main("a : INT := -5; b : REAL := 0.5; c AT %MW0 : INT := 7; t : TIME := T#1s;",
                "a := a;")
    controller = Controller(text)
    assert [controller[n] for n in ("a", "b", "c", "t")] == [-5, 0.5, 7, 10**9]


# ---------------------------------------------------------------- limits and time


def seconds(text):
    start = time.process_time()
    findings(text)
    return time.process_time() - start


GROWING = {
    "IL": lambda n: main("a, x : BOOL;", "LD a\nAND a\nST x\n" * n),
    "IL with labels": lambda n: main("a, x : BOOL;", "\n".join(
        f"l{k}: LD a\nJMPC l{k + 1}\nJMP l{k + 1}" for k in range(n)) + f"\nl{n}:"),
    "IL jumps in a chain": lambda n: main("a : BOOL;", "JMP l0\n" + "\n".join(
        f"l{k}: JMP l{k + 1}" for k in range(n)) + f"\nl{n}:"),
    "ST": lambda n: main("a, x : BOOL;", "x := a AND NOT x;\n" * n),
    "one sum": lambda n: main("a : INT;", "a := a" + " + a" * n + ";"),
    "ELSIF": lambda n: main("a : INT;",
                            "IF a = 0 THEN a := 1;" + "ELSIF a = 1 THEN a := 2;" * n + "END_IF;"),
    "CASE": lambda n: main("a : DINT;",
                           "CASE a OF " + "".join(f"{k}: a := 1;\n" for k in range(n))
                           + "END_CASE;"),
    "variables": lambda n: main("".join(f"v{k} : INT;\n" for k in range(n)), "v0 := v1;"),
    "SFC": lambda n: main("x : BOOL;", "".join(
        f"{'INITIAL_' * (k == 0)}STEP s{k}: x(N); END_STEP\n"
        f"TRANSITION FROM s{k} TO s{(k + 1) % n} := x; "
        "END_TRANSITION\n" for k in range(n))),
    "mistakes": lambda n: main("a : BOOL;", "IF a THEN x := ; END_IF;\n" * n),
    "comments": lambda n: "(*" * n + "*)" * n + ONE,
    "open comments": lambda n: "(*" * n,
    "parentheses": lambda n: main("a : BOOL;", "a := " + "(" * n),
    "words": lambda n: "hello " * n,
    "quotes": lambda n: main("a : BOOL;", "'\n" * n),
    "one name": lambda n: main("a : BOOL;", "a := " + "b" * 20 * n + ";"),
    "nested IF": lambda n: main("a : BOOL;", "IF a THEN " * n),
    "nested AND(": lambda n: main("a : BOOL;", "LD a\n" + "AND(\nLD a\n" * n),
}


@pytest.mark.parametrize("kind", GROWING)
def test_time_grows_no_faster_than_the_text(kind):
    make = GROWING[kind]
    findings(make(30))
    few, many = (min(seconds(make(n)) for _ in range(2)) for n in (150, 1200))
    assert many < 8 * 4 * (few + 0.003)
