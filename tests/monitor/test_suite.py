"""Monitors over traces: verdicts, instants of decision, triggers and the story of a violation."""

from __future__ import annotations

import pytest

from plcemu.base.errors import CompileError
from plcemu.base.tags import Tag, TagTable
from plcemu.base.time import NS_PER_S
from plcemu.base.trace import Frame, Trace
from plcemu.base.types import Value
from plcemu.monitor import Monitor, Result, Suite, judge, parse_properties
from plcemu.monitor.evaluators import General

S = NS_PER_S
HELD = 100


def trace_of(end_s: int, *moments: tuple[float, dict[str, Value]]) -> Trace:
    """Return a trace; the first moment gives every tag its value."""
    types = {bool: "BOOL", int: "LINT", float: "LREAL", str: "STRING"}
    tags = TagTable([Tag(n, types[type(v)]) for n, v in moments[0][1].items()])
    frames = [Frame(round(t * S), i, tuple((tags.find(n), v) for n, v in changes.items()))
              for i, (t, changes) in enumerate(moments)]
    return Trace(tags, frames, end_s * S)


def heater_run(end_s: int, *moments: tuple[float, dict[str, Value]]) -> Trace:
    """Return a run in which a malfunction should switch the heater off."""
    return trace_of(end_s, (0, {"MAIN.malf": False, "MAIN.heater": True}), *moments)


def check(formula: str, trace: Trace) -> Result:
    return Monitor(formula).check(trace)


OFF_IN_22_S = "G (malf -> F[0s,22s] !heater)"


def test_a_goal_exactly_at_the_closed_end_of_the_interval_is_in_time() -> None:
    result = check(OFF_IN_22_S, heater_run(60, (10, {"MAIN.malf": True}),
                                           (32, {"MAIN.heater": False})))
    assert result.verdict == "presumably satisfied"
    assert (result.triggers, result.decided_at_ns, result.vacuous) == (1, None, False)


def test_a_goal_exactly_at_the_open_end_of_the_interval_is_late() -> None:
    result = check("G (malf -> F[0s,22s) !heater)",
                   heater_run(60, (10, {"MAIN.malf": True}), (32, {"MAIN.heater": False})))
    assert (result.verdict, result.decided_at_ns) == ("violated", 32 * S - 1)


def test_a_deadline_violation_is_decided_at_the_deadline_although_no_frame_comes() -> None:
    trace = heater_run(0, (10, {"MAIN.malf": True}))
    suite = Suite(parse_properties(f"off: {OFF_IN_22_S}"), trace.tags)
    [suite.observe(frame) for frame in trace.frames]
    assert suite.next_deadline_ns() == 32 * S
    suite.advance(32 * S - 1)
    assert suite.results()[0].verdict == "presumably violated"
    suite.advance(32 * S)
    assert suite.results()[0].decided_at_ns == 32 * S
    assert suite.next_deadline_ns() is None
    assert suite.undecided == 0


def test_a_violation_tells_trigger_decision_blamed_tags_and_the_last_changes() -> None:
    trace = heater_run(60, (10, {"MAIN.malf": True}), (40, {"MAIN.malf": False}))
    violation = check(OFF_IN_22_S, trace).violation
    assert violation is not None
    assert (violation.trigger_ns, violation.decided_at_ns) == (10 * S, 32 * S)
    assert violation.blamed == (("MAIN.heater", True), ("MAIN.malf", True))
    assert violation.recent == ((0, "MAIN.malf", False), (0, "MAIN.heater", True),
                                (10 * S, "MAIN.malf", True))


def test_of_a_broken_conjunction_only_the_broken_part_is_blamed() -> None:
    trace = trace_of(5, (0, {"a": True, "b": 1}), (3, {"b": 7}))
    violation = check("G (a & b < 5)", trace).violation
    assert violation is not None
    assert violation.blamed == (("b", 7),)


def test_the_table_of_last_changes_is_bounded() -> None:
    trace = trace_of(100, (0, {"n": 0}), *((i, {"n": i}) for i in range(1, 60)))
    violation = check("G n < 50", trace).violation
    assert violation is not None
    assert len(violation.recent) == 20
    assert violation.recent[-1] == (50 * S, "n", 50)


def test_an_open_trigger_at_the_cut_is_presumably_violated() -> None:
    assert check(OFF_IN_22_S, heater_run(20, (10, {"MAIN.malf": True}))
                 ).verdict == "presumably violated"


def test_a_premise_that_was_never_true_makes_the_property_vacuous() -> None:
    result = check(OFF_IN_22_S, heater_run(60))
    assert (result.verdict, result.triggers, result.vacuous) == ("presumably satisfied", 0, True)


@pytest.mark.parametrize(("formula", "triggers"), [
    ("G (a -> b)", 2), ("G (a -> F[0s,5s] b)", 2), ("G (a -> F[1s,5s] b)", 2),
    ("G (a -> O[0s,5s] b)", 2), ("G F[0s,20s] a", 2), ("G F a", 2), ("a -> F b", 0),
    ("G (a -> H b)", 2), ("G (rise(a) -> b)", 2)])
def test_triggers_count_each_time_that_the_premise_became_true(
        formula: str, triggers: int) -> None:
    trace = trace_of(20, (0, {"a": False, "b": True}), (2, {"a": True}), (3, {"a": False}),
                     (9, {"a": True}), (10, {"a": False}))
    assert check(formula, trace).triggers == triggers


def test_an_invariant_counts_the_changes_that_put_it_to_the_test() -> None:
    trace = trace_of(20, (0, {"a": False, "b": 1}), (2, {"b": 2}), (3, {"a": True}))
    assert check("G b > 0", trace).triggers == 2


@pytest.mark.parametrize(("formula", "verdict", "decided_s"), [
    ("G !a", "violated", 2),
    ("F a", "satisfied", 2),
    ("F[0s,1s] a", "violated", 1),
    ("F[3s,5s] a", "violated", 5),
    ("F[2s,5s] a", "satisfied", 2),
    ("F b = 5", "presumably violated", None),
    ("b = 1 U a", "satisfied", 2),
    ("b = 1 U[3s,9s] a", "violated", 4),
    ("b = 1 W b = 9", "violated", 4),
    ("b = 1 W b = 2", "satisfied", 4),
    ("G F[0s,4s] a", "violated", 6.5),
    ("G F a", "presumably violated", None),
    ("G (b = 2 -> O[0s,1s] a)", "violated", 4),
    ("G (b = 2 -> O a)", "satisfied", 2),
    ("G (rise(a) -> H[0s,2s] b = 1)", "presumably satisfied", None),
    ("G (fall(a) -> b = 1 S a)", "presumably satisfied", None),
    ("G (changed(b) -> Y b = 1)", "presumably satisfied", None),
    ("G[0s,1s] !a & F[0s,2s] a", "satisfied", 2),
    ("G (a -> G[0s,1s] b = 1) & F[5s,6s] TRUE", "presumably satisfied", None),
    ("F[0s,3s] G[0s,3s] b = 1", "satisfied", 3),
    ("AG !a", "violated", 2),
    ("A[] b < 3", "presumably satisfied", None),
    ("AF a", "satisfied", 2),
    ("a --> b = 2", "presumably satisfied", None),
    ("!EF a", "violated", 2),
    ("b / (b - 1) > 0", "inconclusive", 0),
])
def test_verdicts_fall_at_the_earliest_instant(
        formula: str, verdict: str, decided_s: float | None) -> None:
    trace = trace_of(8, (0, {"a": False, "b": 1}), (2, {"a": True}), (2.5, {"a": False}),
                     (4, {"b": 2}))
    result = check(formula, trace)
    expected_ns = None if decided_s is None else round(decided_s * S)
    assert (result.verdict, result.decided_at_ns) == (verdict, expected_ns)


@pytest.mark.parametrize(("formula", "message"), [
    ("G MAIN.hetaer", "1:3: M0010 there is no tag 'MAIN.hetaer'; did you mean 'MAIN.heater'?"),
    ("G level", "1:3: M0011 'level' is a number, expected a truth value (compare it, as in x = 1)"),
    ("G level = 'x'", "1:11: M0011 ''x'' is a character string"),
    ("EF heater", "1:1: M0020 'EF' speaks of other runs"),
    ("AG EF heater", "1:4: M0020 'EF' speaks of other runs"),
    ("!AG heater", "1:2: M0020 'AG' speaks of other runs"),
    ("!(heater --> heater)", "1:3: M0020 '-->' speaks of other runs"),
    ("G X F heater", "1:3: M0021 'X' cannot be judged online"),
    ("AX AG heater", "1:1: M0021 'AX' cannot be judged online"),
    ("AG !deadlock", "1:5: M0020 'deadlock' speaks of other runs"),
    ("A[heater U E[heater U heater]]", "1:12: M0020 'EU' speaks of other runs"),
    ("G level[heater + 1] > 0", "1:3: M0010 there is no array 'level' with elements of their own"),
    ("G ago(level + 1, 5s) > 0", "1:7: M0012 'level + 1' stands in ago, expected a tag"),
    ("G ago(level, 5) > 0", "1:14: M0012 '5' stands in ago, expected a duration such as 5s"),
    ("rise(F heater)", "1:6: M0022 'F' stands inside"),
    ("rise(fall(heater))", "1:6: M0022 'fall' stands inside"),
    ("(G heater) = heater", "1:2: M0022 'G' stands inside"),
])
def test_what_cannot_be_judged_is_told_with_its_place_and_why(formula: str, message: str) -> None:
    trace = trace_of(1, (0, {"MAIN.heater": True, "plant.level": 2.5}))
    with pytest.raises(CompileError) as caught:
        check(formula, trace)
    assert message in str(caught.value)


def test_the_mistakes_of_all_properties_are_told_together() -> None:
    with pytest.raises(CompileError) as caught:
        Suite(parse_properties("a: G nope\nb: EF x\nc: G x"), TagTable([Tag("x", "BOOL")]))
    assert [d.code for d in caught.value.diagnostics] == ["M0010", "M0020"]


def test_a_formula_without_any_frame_is_inconclusive() -> None:
    result = check("G x", Trace(TagTable([Tag("x", "BOOL")])))
    assert (result.verdict, result.reason) == ("inconclusive", "there was no frame")


def test_a_tag_without_a_first_value_makes_the_property_inconclusive() -> None:
    tags = TagTable([Tag("x", "BOOL"), Tag("y", "BOOL")])
    result = check("G (x -> y)", Trace(tags, [Frame(0, 0, ((0, True),))]))
    assert (result.verdict, result.reason) == (
        "inconclusive", "the first frame has no value of y")


def test_monitoring_starts_at_the_first_frame() -> None:
    trace = trace_of(20, (5, {"a": False}), (7, {"a": True}))
    assert check("F[0s,2s] a", trace).verdict == "satisfied"
    assert check("F[0s,1s] a", trace).decided_at_ns == 6 * S


def test_a_frame_that_comes_after_its_time_was_passed_is_refused() -> None:
    trace = trace_of(5, (1, {"a": True}), (3, {"a": False}))
    suite = Suite(parse_properties("p: G a"), trace.tags)
    suite.observe(trace.frames[0])
    suite.advance(3 * S)
    with pytest.raises(ValueError, match="3000000000 ns"):
        suite.observe(trace.frames[1])


def test_time_before_the_first_frame_says_nothing() -> None:
    trace = trace_of(5, (1, {"a": True}))
    suite = Suite(parse_properties("p: F[0s,1s] !a"), trace.tags)
    suite.advance(4 * S)
    suite.observe(trace.frames[0])
    assert suite.next_deadline_ns() == 2 * S


def test_a_frame_at_the_deadline_that_changes_other_tags_lets_the_deadline_pass() -> None:
    trace = trace_of(0, (0, {"a": False, "b": False}), (2, {"b": True}))
    assert check("G F[0s,2s] a", trace).decided_at_ns == 2 * S


def test_a_formula_that_keeps_too_many_windows_open_is_inconclusive(
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("plcemu.monitor.network.LIMIT", 10)
    changes = ((float(i), {"a": i % 2 == 0}) for i in range(1, HELD))
    result = check("F (a & G b)", trace_of(HELD, (0, {"a": True, "b": True}), *changes))
    assert result.verdict == "inconclusive"
    assert "more than 10 changes" in result.reason


def test_memory_does_not_grow_with_the_length_of_a_run() -> None:
    changes = [(float(i), {"a": i % 2 == 0}) for i in range(1, 1000)]
    trace = trace_of(1000, (0, {"a": True, "b": True}), *changes)
    suite = Suite(parse_properties("p: G (a -> b S[0s,9s] a & F[1s,5s] a)"), trace.tags)
    [suite.observe(frame) for frame in trace.frames]
    evaluator = suite._watches[0]._evaluator
    assert isinstance(evaluator, General)
    assert max(len(node.known) for node in evaluator.network.order) < 20


def test_the_json_of_a_result_has_the_promised_keys() -> None:
    trace = heater_run(60, (10, {"MAIN.malf": True}))
    entry = parse_properties(f'off "the heater goes off": {OFF_IN_22_S}')
    assert judge(trace, entry)[0].as_json() == {
        "name": "off", "formula": OFF_IN_22_S, "description": "the heater goes off",
        "severity": "error", "pattern": "", "meaning": "", "robustness": None, "obligations": [],
        "verdict": "violated", "triggers": 1, "decided_at_s": 32.0, "vacuous": False, "reason": "",
        "violation": {"trigger_s": 10.0, "decided_at_s": 32.0,
                      "blamed": {"MAIN.heater": True, "MAIN.malf": True},
                      "recent": [{"t_s": 0.0, "tag": "MAIN.malf", "value": False},
                                 {"t_s": 0.0, "tag": "MAIN.heater", "value": True},
                                 {"t_s": 10.0, "tag": "MAIN.malf", "value": True}],
                      "scans": [{"scan": 0, "t_s": 0.0, "changes": {
                                    "MAIN.malf": "FALSE", "MAIN.heater": "TRUE"}},
                                {"scan": 1, "t_s": 10.0, "changes": {"MAIN.malf": "TRUE"}}],
                      "table": "scan  t    MAIN.malf  MAIN.heater\n"
                               "0     0s   FALSE      TRUE\n"
                               "1     10s  TRUE"}}
