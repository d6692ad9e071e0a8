"""Values that are not known: what hinges on them is inconclusive, all else is judged."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from monitor_brute_force import Row
from monitor_runs import check, run_of
from monitor_strategies import TAGS, formulas, responses, runs, trace_of

from plcemu.base.trace import Frame, Trace
from plcemu.monitor import Monitor
from plcemu.monitor.formula import Formula

HEATER = ((0.0, {"malf": False, "heater": True, "x": 5}),)


@pytest.mark.parametrize(("formula", "verdict"), [
    ("G (malf -> F[0s,22s] !heater)", "inconclusive"),
    ("G (malf -> F[0s,3s] !heater)", "violated"),
    ("G !malf", "violated"),
    ("G (malf -> x = 5)", "presumably satisfied"),
    ("F[0s,30s] (malf & !heater)", "inconclusive"),
    ("F[0s,30s] (malf & x = 5)", "satisfied"),
    ("G (malf -> O[0s,10s] !malf)", "presumably satisfied"),
    ("G (malf -> F[1s,22s] !heater)", "inconclusive"),
    ("G changed(heater)", "violated"),
    ("G (x = 5 | rise(heater))", "presumably satisfied"),
    ("G (x = 6 | heater)", "inconclusive"),
    ("G abs(x) >= min(x, 1)", "presumably satisfied"),
])
def test_only_what_hinges_on_the_unknown_value_is_inconclusive(
        formula: str, verdict: str) -> None:
    trace = run_of(40, *HEATER, (10, {"malf": True}), (14, {"heater": None}),
                   (18, {"malf": False}), (20, {"heater": True}))
    assert check(formula, trace).verdict == verdict


def test_the_reason_names_the_value_that_was_missed_and_when() -> None:
    trace = run_of(40, *HEATER, (14, {"heater": None}), (20, {"heater": True}))
    assert check("G (heater | malf)", trace).reason == "heater had no valid value at 14s"


def test_a_goal_after_the_unknown_stretch_answers_the_trigger() -> None:
    trace = run_of(40, *HEATER, (10, {"malf": True}), (14, {"heater": None}),
                   (20, {"heater": False}), (21, {"malf": False}))
    result = check("G (malf -> F[0s,22s] !heater)", trace)
    assert (result.verdict, result.reason) == ("presumably satisfied", "")


def test_an_unknown_value_measures_no_distance() -> None:
    trace = run_of(40, *HEATER, (14, {"x": None}), (20, {"x": 7}))
    result = check("G x < 10", trace)
    assert (result.verdict, result.robustness) == ("inconclusive", 3)


def hidden(trace: Trace, unknown: set[int]) -> Trace:
    """Return a run in which `a` is not known from these instants on until the next frame."""
    frames: list[Frame] = []
    value = None
    for frame in trace.frames:
        changes = dict(frame.changes)
        value = changes.get(0, value)
        changes[0] = None if frame.t_ns in unknown else value
        frames.append(Frame(frame.t_ns, frame.scan, tuple(sorted(changes.items()))))
    return Trace(TAGS, frames, trace.end_ns)


FINAL = ("satisfied", "violated")


@settings(deadline=None)
@given(st.one_of(formulas, responses), runs, st.sets(st.integers(0, 12)))
def test_a_verdict_in_spite_of_unknown_values_is_the_verdict_with_any_values(
        formula: Formula, run: list[Row], unknown: set[int]) -> None:
    trace = trace_of(run)
    partly = Monitor(formula).check(hidden(trace, unknown))
    fully = Monitor(formula).check(trace)
    allowed = {"inconclusive", fully.verdict.value} | (
        # With what was not seen it may have been decided that is still open without.
        {f"presumably {fully.verdict.value}"} if fully.verdict in FINAL else set())
    assert partly.verdict in allowed
    assert partly.verdict not in FINAL or partly.decided_at_ns >= fully.decided_at_ns
