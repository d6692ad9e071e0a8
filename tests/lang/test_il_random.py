"""Random Boolean IL bodies do what the standard's text says, jumps and parentheses included."""

from controller import Controller, main
from hypothesis import given, settings
from hypothesis import strategies as st
from il_oracle import run, text
from il_strategies import NAMES, bodies

from plcemu.ir.check import check_function
from plcemu.ir.text import parse_functions, print_program
from plcemu.lang.compile import compile_program

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
