"""Whatever the text, the compiler ends with a program or with diagnostics inside the text."""

from itertools import pairwise

import pytest
from controller import main
from hypothesis import example, given, settings
from hypothesis import strategies as st
from program_seeds import SEEDS

from plcemu.base.errors import CompileError
from plcemu.engine.resource import Resource
from plcemu.lang.codes import CODES
from plcemu.lang.compile import compile_program

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
        Resource(program, 10_000_000, "interpreter", budget=1000).scan(0)


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
