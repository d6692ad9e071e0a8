"""LTL on random loops, beside the definitions: every run of a few steps, instant by instant."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from monitor_strategies import A, B, N, intervals, responses
from verify_toys import Round, Way, Written, is_fair, judged, rounds, truth, written

from plant_sim.free_inputs import FreeInputs
from plcemu.base.areas import parse_address
from plcemu.base.spans import Diagnostic
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.lang.compile import compile_program
from plcemu.monitor import Property, Suite, parse_formula
from plcemu.monitor.formula import Binary, Formula, Interval, Literal, Unary, walk
from plcemu.monitor.linear import on_one_run
from plcemu.verify.check import Check, Finding, Invariant, Recurrence
from plcemu.verify.ctl import Branching
from plcemu.verify.ltl.check import Linear
from plcemu.verify.path import Path
from plcemu.verify.prove import Prover

basics: st.SearchStrategy[Formula] = st.one_of(
    st.sampled_from([A, B]), st.builds(Binary, st.just("="), st.just(N), st.just(Literal(1))),
    st.just(Literal(True)))
pulses: st.SearchStrategy[Formula] = st.builds(Unary, st.sampled_from(["rise", "fall"]), basics)


def grown(timed: st.SearchStrategy[Interval | None], *more: str) -> st.SearchStrategy[Formula]:
    """Formulas of linear time with the intervals given, and `more` operators without one."""
    def step(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
        return st.one_of(
            st.builds(Unary, st.sampled_from(["!", "X", *more]), inner),
            st.builds(Unary, st.sampled_from(["G", "F"]), inner, timed),
            st.builds(Binary, st.sampled_from(["&", "|", "->", "<->"]), inner, inner),
            st.builds(Binary, st.sampled_from(["U", "W", "R"]), inner, inner, timed),
            *([st.builds(Unary, st.sampled_from(["O", "H"]), inner, timed),
               st.builds(Binary, st.just("S"), inner, inner, timed)] if more else []))
    return st.recursive(st.one_of(basics, pulses) if more else basics, step, max_leaves=4)


def refuted(loop: Written, formula: Formula, longest: int) -> bool:
    """Whether some fair run of a few steps violates a formula."""
    return any(is_fair(loop, run) and not truth(loop, run, formula)
               for run in rounds(loop, longest))


def shown(loop: Written, finding: Finding) -> Round:
    """The run that a finding shows; what ends is continued for ever by some fair round."""
    assert finding.run is not None
    begin = [step.action for step in finding.run.stem]
    if finding.run.cycle:
        return Round(begin, [step.action for step in finding.run.cycle])
    last = begin[-1].after if begin else 0
    return Round(begin, [])._replace(loop=[Way("", 1, last)])


def takes(formula: Formula) -> bool:
    """Whether there is a check of linear time for a formula."""
    return isinstance(Linear.of(formula), Linear)


def agrees(loop: Written, formula: Formula, longest: int) -> None:
    """What is refuted by brute force is violated; and what is shown as violating, violates."""
    finding, _ = judged(loop, formula)
    assert finding.verdict != "inconclusive" or "limit" in finding.reason
    assert finding.verdict != "holds" or not refuted(loop, formula, longest)
    if finding.verdict == "violated" and finding.run is not None and finding.run.cycle:
        run = shown(loop, finding)
        assert is_fair(loop, run) and not truth(loop, run, formula)
    if finding.decided is not None and finding.run is not None:
        begin = [step.action for step in finding.run.stem]
        last = begin[-1].after if begin else 0
        stays = finding.decided[1]
        tails = [tail for tail in rounds_from(loop, last, 3)
                 if [*tail.begin, *tail.loop][0].elapsed_ns > stays]
        for tail in tails:
            assert not truth(loop, Round([*begin, *tail.begin], tail.loop), formula)


def rounds_from(loop: Written, start: int, longest: int) -> list[Round]:
    """Runs of a few steps from a state."""
    def walks(here: int, left: int) -> list[list[Way]]:
        return [[]] + [[way, *rest] for way in (loop.ways[here] if left else ())
                       for rest in walks(way.after, left - 1)]

    return [Round(walk[:k], walk[k:]) for walk in walks(start, longest) for k in range(len(walk))
            if ([start] + [w.after for w in walk])[k] == walk[-1].after]


@settings(max_examples=80, deadline=None)
@given(written(), grown(st.none()))
def test_formulas_of_the_future_are_judged_as_defined(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)


@settings(max_examples=80, deadline=None)
@given(written(longest_ns=3), grown(st.none(), "Y"))
def test_formulas_of_the_past_are_judged_as_defined(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)


@settings(max_examples=80, deadline=None)
@given(written(longest_ns=3), grown(st.one_of(st.none(), intervals(3)), "Y").filter(takes))
def test_formulas_with_durations_are_judged_as_defined(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(["weak", "strong"]).flatmap(lambda f: written(fairness=f)),
       grown(st.none()))
def test_only_fair_runs_count(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)


def test_strong_fairness_excludes_a_run_on_which_something_is_never_done() -> None:
    """In state 0 `b` can be done again and again, but not without a break."""
    rows = [{"a": False}, {"a": False}, {"a": True}]
    ways = [[Way("a", 1, 1), Way("b", 1, 2)], [Way("c", 1, 0)], [Way("c", 1, 0)]]
    verdicts = {}
    for fairness in ("none", "weak", "strong"):
        loop = Written(rows, ways, [frozenset("b"), frozenset(), frozenset()], fairness)  # type: ignore[arg-type]
        verdicts[fairness] = [judged(loop, parse_formula(text), of)[0].verdict for text, of in (
            ("G F a", Linear.of), ("G F a", Recurrence.of), ("AF a", Branching.of))]
    assert verdicts == {"none": ["violated"] * 3, "weak": ["violated"] * 3,
                        "strong": ["holds"] * 3}


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(["none", "weak", "strong"]).flatmap(lambda f: written(fairness=f)),
       st.sampled_from([
           ("G a", Invariant.of), ("G (a -> b)", Invariant.of), ("G F a", Recurrence.of),
           ("G F a & G F b", Recurrence.of), ("AF a", Branching.of), ("A[a U b]", Branching.of),
           ("A[a W b]", Branching.of), ("a --> b", Branching.of), ("AX a", Branching.of),
           ("A[a R b]", Branching.of), ("AG AF a", Branching.of)]))
def test_every_check_says_the_same_of_what_several_can_judge(
        loop: Written, both: tuple[str, Callable[[Formula], Check | None]]) -> None:
    text, of = both
    linear: list[Diagnostic] = []
    formula = on_one_run(parse_formula(text), linear)
    assert judged(loop, formula)[0].verdict == judged(loop, parse_formula(text), of)[0].verdict
    assert not linear


@pytest.mark.parametrize(("text", "idle"), [
    ("G (a -> F b)", ()), ("G (b & !b -> F a)", ("b & !b is never true",)),
    ("G F (a | n = 2)", ("it holds whatever n = 2 is",)),
    ("G (a -> F[0ns,3ns] b)", ()), ("G (n = 2 -> F[0ns,3ns] a)", ("n = 2 is never true",)),
    ("!b W a | G F n = 2", ("it holds whatever G F n = 2 is",)),
    ("n = 1 -> F n = 2", ("it holds whatever F n = 2 is",)),
    ("G F (n = 1 -> b)", ("it holds whatever b is",))])
def test_parts_that_do_not_matter_are_told(text: str, idle: tuple[str, ...]) -> None:
    loop = Written([{"a": False, "b": False, "n": 0}, {"a": True, "b": False, "n": 1},
                    {"a": False, "b": True, "n": 0}],
                   [[Way("a", 1, 1)], [Way("a", 1, 2)], [Way("a", 1, 0)]], [frozenset()] * 3)
    finding, _ = judged(loop, parse_formula(text))
    assert (finding.verdict, finding.vacuous_in) == ("holds", idle)


@pytest.mark.parametrize(("text", "idle"), [
    ("G F a", ()), ("G F (a & n = 1)", ()), ("G F (a | n = 2)", ("it holds whatever n = 2 is",)),
    ("G F b & G F (b | a)", ("it holds whatever b is", "it holds whatever a is")),
    ("G F (n = 1 -> b)", ("it holds whatever b is",))])
def test_parts_that_need_not_come_again_are_told(text: str, idle: tuple[str, ...]) -> None:
    loop = Written([{"a": False, "b": False, "n": 0}, {"a": True, "b": False, "n": 1},
                    {"a": False, "b": True, "n": 0}],
                   [[Way("a", 1, 1)], [Way("a", 1, 2)], [Way("a", 1, 0)]], [frozenset()] * 3)
    finding, _ = judged(loop, parse_formula(text), Recurrence.of)
    assert (finding.verdict, finding.vacuous_in) == ("holds", idle)


def test_each_initial_state_has_its_own_verdict() -> None:
    rows = [{"a": True}, {"a": False}, {"a": False}]
    loop = Written(rows, [[Way("a", 1, 0)], [Way("a", 1, 0)], [Way("a", 1, 2)]],  # type: ignore[arg-type]
                   [frozenset()] * 3, starting=3)
    for text, of, refuted_from in (("G F a", Linear.of, {2}), ("a", Linear.of, {1, 2}),
                                   ("AF a", Branching.of, {2}), ("AG EX a", Branching.of, {2})):
        assert judged(loop, parse_formula(text), of)[0].violated_from == refuted_from


COUNTING = compile_program("""PROGRAM MAIN
VAR a AT %IX0.0 : BOOL; b AT %QX0.0 : BOOL; n : INT; END_VAR
IF a AND n < 2 THEN n := n + 1; ELSIF NOT a THEN n := 0; END_IF;
b := n = 2;
END_PROGRAM
""")


def varies(formula: Formula) -> bool:
    """Whether no part is TRUE or FALSE by itself, which the monitors work out beforehand."""
    return Literal(True) not in walk(formula)


def first_to_fall(formula: Formula, path: Path) -> tuple[str, int | None]:
    """What the monitor says of a path's scans, and of time after them, and when."""
    suite = Suite([Property("it", formula)], path.predicates.tags)
    [suite.observe(frame) for frame in path.trace().frames]
    result, = suite.finish(path.ends_at_ns)
    return result.verdict.value, result.decided_at_ns


@settings(max_examples=60, deadline=None)
@given(responses.filter(takes).filter(varies))
def test_on_a_real_program_the_monitor_falls_at_the_instant_that_the_proof_names(
        formula: Formula) -> None:
    prover = Prover(Resource(COUNTING, 5), FreeInputs({"x": [False, True]}),
                    [Point("x", parse_address("%IX0.0"))], [], 5, [Property("it", formula)], "none")
    proof, = prover.prove().proofs
    assert proof.finding.verdict in ("holds", "violated")
    assume(proof.path is not None and proof.path.repeats_from is None)
    assert proof.path is not None
    assert first_to_fall(formula, proof.path) == ("violated", proof.path.ends_at_ns)
