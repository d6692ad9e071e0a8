"""CTL beside its definition: what holds on random graphs, by unfolding fixed points naively."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.monitor import parse_properties
from plcemu.monitor.formula import Binary, Formula, Literal, TagRef, Unary
from plcemu.verify.check import Evidence
from plcemu.verify.ctl import Branching, Model, core, is_ctl
from plcemu.verify.explore import explore
from plcemu.verify.loop import State
from plcemu.verify.ltl.linear import units


def read(text: str) -> Formula:
    return parse_properties(f"it: {text}")[0].formula


class Toy:
    """A graph as a transition system without fairness: node n is followed by `after[n]`."""

    merge, fairness = "none", "weak"

    def __init__(self, after: list[list[int]], marks: list[int]) -> None:
        self.after, self.marks = after, marks

    def initial(self) -> list[State]:
        return [self.state(n) for n in range(len(self.after))]

    def state(self, n: int) -> State:
        return State(bytes([n]), None, self.marks[n])

    def actions(self, state: State) -> list[int]:
        return self.after[state.memory[0]]

    def next(self, state: State, action: int) -> State:
        return self.state(action)

    def pending(self, state: State) -> tuple[str, ...]:
        return ()

    def done(self, action: int) -> tuple[str, ...]:
        return ()


P, Q = TagRef("p"), TagRef("q")
graphs = st.integers(1, 6).flatmap(lambda n: st.tuples(
    st.lists(st.lists(st.integers(0, n - 1), max_size=3, unique=True), min_size=n, max_size=n),
    st.lists(st.integers(0, 3), min_size=n, max_size=n)))
UNARY, PAIRS = ("AX", "AG", "AF", "EX", "EG", "EF", "!"), ("AU", "AW", "AR", "EU", "EW", "ER",
                                                           "-->", "&", "|", "->", "<->", "xor")
formulas: Any = st.recursive(st.sampled_from([P, Q, Literal(True)]), lambda inner: st.one_of(
    st.builds(Unary, st.sampled_from(UNARY), inner),
    st.builds(Binary, st.sampled_from(PAIRS), inner, inner)), max_leaves=5)


def holds(after: list[list[int]], marks: list[int], f: Formula) -> set[int]:
    """The states where f holds, each operator by the fixed point that defines it."""
    every = set(range(len(after)))
    succ = [set(row) or {n} for n, row in enumerate(after)]

    def some(goal: set[int]) -> set[int]:
        return {n for n in every if succ[n] & goal}

    def all_(goal: set[int]) -> set[int]:
        return {n for n in every if succ[n] <= goal}

    def fixed(step: Any, x: set[int]) -> set[int]:
        while step(x) != x:
            x = step(x)
        return x

    if isinstance(f, Literal):
        return every if f.value else set()
    if isinstance(f, TagRef):
        return {n for n in every if marks[n] >> "pq".index(f.name) & 1}
    if isinstance(f, Unary):
        a = holds(after, marks, f.arg)
        return {"!": lambda: every - a, "AX": lambda: all_(a), "EX": lambda: some(a),
                "AG": lambda: fixed(lambda x: a & all_(x), every),
                "EG": lambda: fixed(lambda x: a & some(x), every),
                "AF": lambda: fixed(lambda x: a | all_(x), set()),
                "EF": lambda: fixed(lambda x: a | some(x), set())}[f.op]()
    assert isinstance(f, Binary)
    a, b = holds(after, marks, f.left), holds(after, marks, f.right)
    fate = fixed(lambda x: b | all_(x), set())
    return {"&": lambda: a & b, "|": lambda: a | b, "->": lambda: every - a | b,
            "<->": lambda: every - (a ^ b), "xor": lambda: a ^ b,
            "AU": lambda: fixed(lambda x: b | a & all_(x), set()),
            "EU": lambda: fixed(lambda x: b | a & some(x), set()),
            "AW": lambda: fixed(lambda x: b | a & all_(x), every),
            "EW": lambda: fixed(lambda x: b | a & some(x), every),
            "AR": lambda: fixed(lambda x: b & (a | all_(x)), every),
            "ER": lambda: fixed(lambda x: b & (a | some(x)), every),
            "-->": lambda: fixed(lambda x: (every - a | fate) & all_(x), every)}[f.op]()


def model_of(after: list[list[int]], marks: list[int], f: Formula) -> tuple[Model, Formula]:
    inner = core(f)
    known = list(dict.fromkeys(units(inner)))
    seen = [sum(1 << k for k, a in enumerate(known) if n in holds(after, marks, a))
            for n in range(len(after))]
    toy: Any = Toy(after, seen)
    evidence = Evidence(toy, explore(toy), 0, 0, lambda n, s: bool(s.seen >> n & 1))
    return Model(evidence, {a: k for k, a in enumerate(known)}), inner


@settings(max_examples=300, deadline=None)
@given(graphs, formulas)
def test_each_operator_holds_where_its_fixed_point_says(
        graph: tuple[list[list[int]], list[int]], formula: Formula) -> None:
    model, inner = model_of(*graph, formula)
    assert model.where(inner) == holds(*graph, formula)


@settings(max_examples=150, deadline=None)
@given(graphs, formulas)
def test_a_story_is_a_walk_along_transitions(
        graph: tuple[list[list[int]], list[int]], formula: Formula) -> None:
    model, inner = model_of(*graph, formula)
    for start in range(len(graph[0])):
        here = start
        story = model.story(inner, start, start in model.where(inner))
        for step in [*story.steps, *story.cycle]:
            assert step.target in graph[0][here]
            here = step.target


def test_the_way_to_a_state_without_return_ends_there() -> None:
    model, inner = model_of([[1], [1, 2], [2]], [1, 1, 0], read("AG EF p"))
    story = model.story(inner, 0, truth=False)
    assert [s.target for s in story.steps] == [1, 2]
    assert story.remark == "from here on no run reaches p"


@pytest.mark.parametrize("text", ["AG EF p", "A[p U (q)]", "AG (p -> AX q)", "p --> q", "E[p W q]"])
def test_formulas_of_branching_time_have_a_check(text: str) -> None:
    assert is_ctl(read(text)) and Branching.of(read(text)) is not None


@pytest.mark.parametrize("text", ["G (p -> F q)", "AG (Y p)", "AG EF rise(p)", "p U q", "p"])
def test_other_formulas_are_left_to_other_checks(text: str) -> None:
    assert Branching.of(read(text)) is None


def test_every_scan_must_be_seen() -> None:
    check = Branching.of(read("AG EF p"))
    assert check is not None and "merge: none" in check.unfit_for("stable")
    assert not check.unfit_for("none")
