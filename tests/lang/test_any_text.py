"""Whatever the text, the compiler ends with a program or with diagnostics inside the text."""

from itertools import pairwise
from pathlib import Path

import pytest
from controller import main
from hypothesis import example, given, settings
from hypothesis import strategies as st

from plcemu.base.errors import CompileError
from plcemu.engine.resource import Resource
from plcemu.lang.codes import CODES
from plcemu.lang.compile import compile_program

PROGRAMS = Path(__file__).parents[2] / "il_programs"
BATCH_PLANT = (PROGRAMS / "batch_plant/batch_plant.sfc").read_text("utf-8")

SEEDS = (
    BATCH_PLANT[:6000],
    "FUNCTION_BLOCK F VAR_INPUT a : BOOL; n : INT := 3; END_VAR VAR_OUTPUT q : BOOL; END_VAR\n"
    "VAR t : TON; k : INT; END_VAR t(IN := a, PT := T#50ms, Q => q);\nFOR k := 1 TO n DO\n"
    "IF k = 2 THEN EXIT; ELSIF a THEN RETURN; END_IF; END_FOR;\n"
    "CASE n OF 1: k := 2; 3..5: k := 7;\n"
    "ELSE k := -n; END_CASE; REPEAT k := k + 1; UNTIL k > 10 END_REPEAT; END_FUNCTION_BLOCK\n"
    + main("f : F; x AT %QX0.0 : BOOL; r : REAL; w : WORD;",
           "f(a := NOT x, n := 4); x := f.q; r := r * 0.5 + 1.0; w := w XOR 16#FF;"),
    main("a, b, x : BOOL; i : INT; t : TON;",
         "start: LD a\nANDN( b\nOR x\nXOR(\nLDN a\n)\n)\nST x\nSTN b\n"
         "LD i\nADD 1\nMUL( i\nSUB 3\n)\n"
         "ST i\nGT 100\nJMPCN start\nCAL t(\nIN := a,\nPT := T#1s,\nQ => b\n)\n"
         "LD x\nS a\nR b\nRETC\n"
         "CALC t(b)\nJMP the_end\nthe_end:"),
    ("PROGRAM P VAR x : BOOL; END_VAR INITIAL_STEP A: x(N); act(SD, T#5s); END_STEP\n"
     "STEP B: x(R); END_STEP TRANSITION t1 (PRIORITY := 1) FROM A TO (B, C) := A.T > T#1s;\n"
     "END_TRANSITION STEP C: END_STEP\nTRANSITION FROM (B, C) TO A : LD x ANDN B.X END_TRANSITION\n"
     "ACTION act: LD x\nSTN x\nEND_ACTION\nEND_PROGRAM"),
)
WORDS = sorted({w for seed in SEEDS for w in seed.replace("(",
                                                          " ( ").split()} | set("()[];:=,.#%'\"$&")
               | {":=", "=>", "..", "(*", "*)", "{", "T#", "16#", "INT#", "%IX", "\ufeff", "\u00e4",
                  "\u0661", "\x00", "1e999", "1.0E999", "9" * 30, "END_VAR", "VAR_TEMP", "NOT",
                  "-"})


def ends_well(text):
    """Compile; every diagnostic has a known code and a place inside the text."""
    try:
        program = compile_program(text)
    except CompileError as error:
        assert error.errors
        for diagnostic in error.diagnostics:
            assert diagnostic.code in CODES
            span = diagnostic.span
            assert 0 <= span.start <= span.end <= len(span.source.text)
            assert span.source.name == "<text>"
    else:
        Resource(program, 10_000_000, budget=1000).scan(0)


@given(st.text(max_size=200))
@settings(max_examples=150, deadline=None)
def test_any_characters(text):
    ends_well(text)


@given(st.lists(st.sampled_from(WORDS), max_size=60), st.sampled_from([" ", "\n"]))
@settings(max_examples=200, deadline=None)
def test_any_soup_of_words(words, joint):
    ends_well(joint.join(words))


@given(st.lists(st.sampled_from(WORDS), max_size=40), st.sampled_from([" ", "\n"]))
@settings(max_examples=200, deadline=None)
def test_any_soup_of_words_as_a_body(words, joint):
    ends_well(main("a, b, x : BOOL; i : INT; t : TON;", joint.join(words)))


edits = st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 30),
                           st.sampled_from(["", *WORDS])),
                 min_size=1, max_size=4)


@given(st.sampled_from(SEEDS), edits)
@example(SEEDS[3], [(0, 0, "")])
@settings(max_examples=250, deadline=None)
def test_any_program_with_stretches_replaced(seed, changes):
    for at, size, new in changes:
        start = at % (len(seed) + 1)
        seed = seed[:start] + new + seed[start + size:]
    ends_well(seed)


@pytest.mark.parametrize("seed", SEEDS[1:])
def test_any_beginning_of_a_program(seed):
    for end in range(0, len(seed), 7):
        ends_well(seed[:end])


@pytest.mark.parametrize("seed", SEEDS[1:])
def test_any_program_without_one_of_its_words(seed):
    ends_well(seed)
    spaces = [-1, *(i for i, c in enumerate(seed) if c.isspace())]
    for before, after in pairwise(spaces):
        ends_well(seed[:before + 1] + seed[after:])
