"""LTL on random loops, beside the definitions: every run of a few steps, instant by instant."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from monitor_strategies import A, B, N, intervals
from verify_toys import Round, Way, Written, is_fair, judged, rounds, truth, written

from plcemu.monitor.formula import Binary, Formula, Interval, Literal, Unary
from plcemu.verify.check import Finding
from plcemu.verify.ltl import Linear

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
        for tail in rounds_from(loop, last, 3):
            assert not truth(loop, Round([*begin, *tail.begin], tail.loop), formula)


def rounds_from(loop: Written, start: int, longest: int) -> list[Round]:
    """Runs of a few steps from a state."""
    def walks(here: int, left: int) -> list[list[Way]]:
        return [[]] + [[way, *rest] for way in (loop.ways[here] if left else ())
                       for rest in walks(way.after, left - 1)]

    return [Round(walk[:k], walk[k:]) for walk in walks(start, longest) for k in range(len(walk))
            if ([start] + [w.after for w in walk])[k] == walk[-1].after]


@settings(max_examples=150, deadline=None)
@given(written(), grown(st.none()))
def test_formulas_of_the_future_are_judged_as_defined(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)


@settings(max_examples=150, deadline=None)
@given(written(longest_ns=3), grown(st.none(), "Y"))
def test_formulas_of_the_past_are_judged_as_defined(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)


@settings(max_examples=150, deadline=None)
@given(written(longest_ns=3), grown(st.one_of(st.none(), intervals(3)), "Y").filter(takes))
def test_formulas_with_durations_are_judged_as_defined(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(["weak", "strong"]).flatmap(lambda f: written(fairness=f)),
       grown(st.none()))
def test_only_fair_runs_count(loop: Written, formula: Formula) -> None:
    agrees(loop, formula, 4)
