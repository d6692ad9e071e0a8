"""Whole programs on both engines with random values in their tags, compared after every scan."""

from pathlib import Path

import pytest
from controller import main
from engines_compared import Pair
from hypothesis import given, settings
from hypothesis import strategies as st
from il_oracle import text
from il_strategies import bodies
from program_seeds import SEEDS

from plcemu.base.errors import CompileError
from plcemu.lang.compile import compile_program

ROOT = Path(__file__).parents[2]
FILES = sorted([*(ROOT / "tests/programs").glob("*.st"),
                *(p for kind in ("il", "st", "sfc", "sipn")
                  for p in (ROOT / "il_programs").rglob(f"*.{kind}"))])


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_a_program_from_a_file(path):
    program = compile_program(path)
    inputs = [s.tag.name for s in program.layout.slots if s.tag.address.startswith("%I")]
    Pair(program, 100_000).scan_with_random_inputs(1, 60, inputs)
    Pair(program, 100_000).scan_with_random_inputs(2, 60)


def compiled(seed):
    try:
        return compile_program(seed)
    except CompileError:
        return None


PROGRAMS = [p for p in map(compiled, SEEDS) if p is not None]


def test_there_are_programs_of_all_languages():
    assert len(PROGRAMS) >= 6


@pytest.mark.parametrize("n", range(len(PROGRAMS)))
def test_a_program_that_uses_much_of_the_language(n):
    Pair(PROGRAMS[n], 5_000).scan_with_random_inputs(n, 80)


@given(bodies(), st.integers(0, 2**32))
@settings(max_examples=100, deadline=None)
def test_a_random_il_body(body, seed):
    program = compile_program(main("a, b, c, d : BOOL;", text(body)))
    Pair(program).scan_with_random_inputs(seed, 6)


NAMES = ("x", "y", "n", "k", "r", "w")

st_terms = st.recursive(
    st.sampled_from(["n", "k", "a[1 + ABS(n) MOD 3]", "3", "-7", "0", "s.p"]),
    lambda inner: st.builds("({} {} {})".format, inner,
                            st.sampled_from(["+", "-", "*", "/", "MOD"]), inner)
    | st.builds("SEL({}, {}, {})".format, st.just("x"), inner, inner)
    | st.builds("REAL_TO_INT(INT_TO_REAL({}) * 0.37)".format, inner), max_leaves=8)
st_conditions = st.builds("{} {} {}".format, st_terms, st.sampled_from(["<", ">=", "=", "<>"]),
                          st_terms) | st.sampled_from(["x", "NOT y", "x XOR y", "w > 16#F0"])
st_assignments = st.builds("{} := {};".format, st.sampled_from(["n", "k", "s.p", "a[k]", "a[2]"]),
                           st_terms) \
    | st.builds("{} := {};".format, st.sampled_from(["x", "y"]), st_conditions) \
    | st.just("w := SHL(w, 1) OR 1;") | st.just("r := r * 0.5 + INT_TO_REAL(n);") \
    | st.just("t(IN := x, PT := T#25ms, Q => y);") | st.just("c(CU := y, PV := 3);") \
    | st.just("z := CONCAT(LEFT(z, 3), INT_TO_STRING(k));") | st.just("EXIT;")
st_statements = st.recursive(
    st_assignments,
    lambda inner: st.builds("IF {} THEN {} ELSE {} END_IF;".format, st_conditions, inner, inner)
    | st.builds("FOR k := {} TO {} DO {} END_FOR;".format, st.integers(-2, 2), st.integers(0, 4),
                inner)
    | st.builds("WHILE {} DO {} n := n + 1; END_WHILE;".format, st_conditions, inner)
    | st.builds("CASE n OF 0: {} 1..5: {} ELSE {} END_CASE;".format, inner, inner, inner)
    | st.builds("{} {}".format, inner, inner), max_leaves=8)
DECLARED = ("x, y : BOOL; n, k : INT; r : REAL; w : WORD; t : TON; c : CTU; z : STRING[9];"
            "a : ARRAY [1..3] OF INT; s : STRUCT p : INT; END_STRUCT;")


@given(st_statements, st.integers(0, 2**32))
@settings(max_examples=100, deadline=None)
def test_a_random_st_body(body, seed):
    program = compiled(main(DECLARED, body if "EXIT" not in body
                            else f"FOR n := 1 TO 3 DO {body} END_FOR;"))
    if program is not None:
        Pair(program, 2_000).scan_with_random_inputs(seed, 6)
