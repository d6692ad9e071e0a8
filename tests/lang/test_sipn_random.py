"""Random nets and inputs: the compiled net, the net exported as IL and the paper's rules agree."""

from controller import Controller
from hypothesis import given, settings
from hypothesis import strategies as st
from sipn_oracle import Net, Run, Transition

from plcemu.lang.compile import compile_program
from plcemu.lang.sipn_il import export_il

PLACES = ["P1", "P2", "P3", "P4", "P5"]
INPUTS = ["a", "b", "c"]
OUTPUTS = ["x", "y"]

conditions = st.recursive(st.sampled_from(INPUTS), lambda inner: st.one_of(
    st.tuples(st.just("NOT"), inner),
    st.tuples(st.sampled_from(["AND", "OR", "XOR"]), inner, inner)), max_leaves=4)
sides = st.frozensets(st.sampled_from(PLACES), max_size=2)
given_values = st.dictionaries(st.sampled_from(OUTPUTS), st.booleans())


@st.composite
def nets(draw: st.DrawFn) -> Net:
    names = [f"T{n}" for n in range(1, draw(st.integers(1, 7)) + 1)]
    transitions = tuple(Transition(name, draw(sides), draw(sides), draw(conditions))
                        for name in names)
    initial = draw(st.frozensets(st.sampled_from(PLACES), min_size=1))
    return Net({p: draw(given_values) for p in PLACES}, initial, transitions)


runs = st.lists(st.fixed_dictionaries({name: st.booleans() for name in INPUTS}),
                min_size=1, max_size=8)


def told_by(program, inputs, names):
    controller, rows = Controller(program), []
    for row in inputs:
        for name, value in row.items():
            controller[name] = value
        controller.scan()
        rows.append({name: controller[name] for name in names})
    return rows


@given(nets(), runs)
@settings(max_examples=60, deadline=None)
def test_a_scan_fires_until_the_marking_is_stable(net, inputs):
    run = Run(net)
    expected = [run.scan(row) for row in inputs]
    names = expected[0]
    assert told_by(compile_program(net.text()), inputs, names) == expected
    assert told_by(compile_program(export_il(net.text())), inputs, names) == expected


@given(nets(), runs)
@settings(max_examples=60, deadline=None)
def test_with_single_firing_a_scan_is_one_state_of_the_state_graph(net, inputs):
    run = Run(net)
    expected = [run.step(row) for row in inputs]
    names = expected[0]
    text = net.text()
    assert told_by(compile_program(text, single_firing=True), inputs, names) == expected
    exported = compile_program(export_il(text, single_firing=True))
    assert told_by(exported, inputs, names) == expected
