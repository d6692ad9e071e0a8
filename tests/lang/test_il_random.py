"""Random Boolean IL bodies do what the standard's text says, jumps and parentheses included."""

from controller import Controller, main
from hypothesis import given, settings
from hypothesis import strategies as st
from il_oracle import Line, run, text

from plcemu.ir.check import check_function
from plcemu.ir.text import parse_functions, print_program
from plcemu.lang.compile import compile_program

NAMES = ["a", "b", "c", "d"]

variables = st.sampled_from(NAMES)
loads = st.builds(Line, st.just("LD"), st.booleans(), variables)
stores = st.builds(Line, st.just("ST"), st.booleans(), variables)
latches = st.builds(Line, st.sampled_from(["S", "R"]), st.just(False), variables)
logic = st.builds(Line, st.sampled_from(["AND", "OR", "XOR"]), st.booleans(), variables)
inversions = st.builds(Line, st.just("NOT"))
returns = st.builds(Line, st.just("RETC"), st.booleans())
simple = st.one_of(loads, stores, latches, logic, inversions)


def deferred(inner: st.SearchStrategy[Line]) -> st.SearchStrategy[Line]:
    nested = st.tuples(loads, st.lists(inner, max_size=3)).map(lambda pair: (pair[0], *pair[1]))
    return st.builds(Line, st.sampled_from(["AND", "OR", "XOR"]), st.booleans(), nested)


instructions = st.one_of(simple, returns, st.recursive(logic, deferred, max_leaves=4))


@st.composite
def bodies(draw: st.DrawFn) -> tuple[Line, ...]:
    """A body that begins with LD and jumps forwards only."""
    lines = [draw(loads), *draw(st.lists(instructions, min_size=1, max_size=14))]
    end = len(lines)
    for at in draw(st.sets(st.integers(1, end - 1), max_size=5)):
        op = draw(st.sampled_from(["JMP", "JMPC"]))
        negated = op == "JMPC" and draw(st.booleans())
        lines[at] = Line(op, negated, "", draw(st.integers(at + 1, end)))
    return tuple(lines)


states = st.fixed_dictionaries({name: st.booleans() for name in NAMES})


@given(bodies(), states)
@settings(max_examples=300, deadline=None)
def test_a_random_body_computes_what_the_standard_says(body, state):
    expected = dict(state)
    run(body, expected)
    controller = Controller(main("a, b, c, d : BOOL;", text(body)))
    for name, value in state.items():
        controller[name] = value
    controller.scan()
    assert {name: controller[name] for name in NAMES} == expected


@given(bodies())
@settings(max_examples=60, deadline=None)
def test_the_code_of_a_random_body_reads_back_from_its_text_and_keeps_the_rules(body):
    program = compile_program(main("a, b, c, d : BOOL;", text(body)))
    again = parse_functions(print_program(program))
    for name, function in program.functions.items():
        assert [(i.op, i.arg) for i in again[name].code] == [(i.op, i.arg) for i in function.code]
        check_function(again[name], again)
