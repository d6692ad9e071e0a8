"""The monitor and a plain reading of the definitions agree, on any formula and run."""

from __future__ import annotations

from hypothesis import example, given, settings
from hypothesis import strategies as st
from monitor_brute_force import Row, decided_at, presumed
from monitor_strategies import TAGS, A, B, formulas, frames_of, responses, runs, trace_of

from plcemu.base.spans import Diagnostic
from plcemu.monitor import Monitor, Property, Suite
from plcemu.monitor.bind import Binder
from plcemu.monitor.evaluators import General
from plcemu.monitor.formula import Binary, Formula, Interval, Literal, Unary
from plcemu.monitor.linear import on_one_run
from plcemu.monitor.signals import NO, YES
from plcemu.monitor.verdict import FINAL, PRESUMED

START_NS = 7
CODES = {False: NO, True: YES}


def expected(formula: Formula, run: list[Row]) -> tuple[str, int | None]:
    """Return the verdict and the instant of decision, by brute force."""
    decision = decided_at(formula, run)
    return ((PRESUMED[CODES[presumed(formula, run)]].value, None) if decision is None
            else (FINAL[CODES[decision[1]]].value, START_NS + decision[0]))


def found(formula: Formula, run: list[Row]) -> tuple[str, int | None]:
    """Return the verdict and the instant of decision, by the monitor."""
    result = Monitor(formula).check(trace_of(run, START_NS))
    return result.verdict.value, result.decided_at_ns


@settings(deadline=None)
@given(formulas, runs)
@example(Binary("U", A, Literal(True), Interval(1, None, False)), [{"a": True, "b": False, "n": 0}])
def test_any_formula_gets_the_verdict_and_instant_that_the_definitions_give(
        formula: Formula, run: list[Row]) -> None:
    assert found(formula, run) == expected(formula, run)


@settings(deadline=None)
@given(responses, runs)
@example(Unary("G", Binary("->", A, Unary("F", B, Interval(0, 3, True, False)))),
         [{"a": True, "b": False, "n": 0}] * 3)
def test_a_response_property_gets_the_verdict_and_instant_that_the_definitions_give(
        formula: Formula, run: list[Row]) -> None:
    assert found(formula, run) == expected(formula, run)


@settings(deadline=None)
@given(st.one_of(formulas, responses), runs)
def test_telling_of_every_passing_ns_changes_no_result(formula: Formula, run: list[Row]) -> None:
    suite = Suite([Property("property", formula)], TAGS)
    frames = {frame.t_ns: frame for frame in frames_of(run, START_NS)}
    for t_ns in range(START_NS, START_NS + len(run)):
        [suite.observe(frames[t_ns]) for _ in range(t_ns in frames)]
        suite.advance(t_ns)
    assert suite.results()[0] == Monitor(formula).check(trace_of(run, START_NS))


@settings(deadline=None)
@given(responses, runs)
def test_the_short_way_and_the_general_way_tell_the_same_story(
        formula: Formula, run: list[Row]) -> None:
    trace = trace_of(run, START_NS)
    general = Suite([Property("property", formula)], TAGS)
    found: list[Diagnostic] = []
    binder = Binder(TAGS, found)
    linear = binder.check(on_one_run(formula, found))
    general._watches[0].use(General(linear, binder))
    [general.observe(frame) for frame in trace.frames]
    slow, quick = general.finish(trace.end_ns)[0], Monitor(formula).check(trace)
    assert (slow.verdict, slow.violation) == (quick.verdict, quick.violation)


@settings(deadline=None)
@given(st.one_of(formulas, responses), runs)
def test_the_next_deadline_is_where_time_alone_decides(formula: Formula, run: list[Row]) -> None:
    suite = Suite([Property("property", formula)], TAGS)
    [suite.observe(frame) for frame in frames_of(run)]
    held = run + [run[-1]] * 40
    open_yet = decided_at(formula, run) is None
    decision = decided_at(formula, held) if open_yet else None
    suite.advance(len(run) - 1)
    assert suite.next_deadline_ns() == (decision[0] if decision else None)
