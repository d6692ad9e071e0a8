"""What the words of the property language mean, on runs that can be read at a glance."""

from __future__ import annotations

import pytest
from monitor_runs import Changes, S, check, run_of

from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.monitor import Severity, Suite, judge, parse_properties

LEVELS: tuple[tuple[float, Changes], ...] = (
    (0, {"MAIN.level[1]": 10, "MAIN.level[2]": 20, "MAIN.n": 1, "MAIN.on": False}),
    (2, {"MAIN.n": 2}), (4, {"MAIN.level[2]": 28}), (5, {"MAIN.on": True}))


@pytest.mark.parametrize(("formula", "verdict", "decided_s"), [
    ("G level[n] < 25", "violated", 4),
    ("G level[n] < 30", "presumably satisfied", None),
    ("G (level[n + 1] < 30)", "inconclusive", 2),
    ("G level[2] - previous(level[2]) <= 5", "violated", 4),
    ("G (changed(n) -> n = previous(n) + 1)", "presumably satisfied", None),
    ("G level[2] - ago(level[2], 3s) <= 5", "violated", 4),
    ("F ago(on, 2s)", "satisfied", 7),
    ("G (on -> ago(n, 3s) = 2)", "presumably satisfied", None),
    ("G (on -> ago(n, 3001ms) = 2)", "violated", 5),
    ("G abs(level[1] - level[2]) <= 10", "violated", 4),
    ("G max(level[1], level[2], 5) < 28", "violated", 4),
    ("G min(level[1], n) = n", "presumably satisfied", None),
    ("G level[2] MOD 10 = 0", "violated", 4),
    ("F (on xor n = 2)", "satisfied", 2),
    ("G level[2] <> 16#1C", "violated", 4),
])
def test_arrays_earlier_values_and_functions(
        formula: str, verdict: str, decided_s: float | None) -> None:
    result = check(formula, run_of(9, *LEVELS))
    assert (result.verdict, result.decided_at_ns) == (
        verdict, None if decided_s is None else decided_s * S)


def test_an_element_that_does_not_exist_is_the_reason_of_an_inconclusive_verdict() -> None:
    result = check("G level[n + 1] < 30", run_of(9, *LEVELS))
    assert result.reason == "there is no element at [3], asked for by level[n + 1]"


def test_values_of_an_enumeration_are_written_by_their_names() -> None:
    tags = TagTable([Tag("MAIN.mode", "DINT", values=(("IDLE", 0), ("FILL", 5), ("HEAT", 6)))])
    trace = Trace(tags, [Frame(n * S, n, ((0, mode),)) for n, mode in enumerate((0, 5, 6))])
    result = check("G (mode = Mode#HEAT -> previous(mode) = IDLE)", trace)
    assert result.decided_at_ns == 2 * S
    assert result.violation is not None
    assert result.violation.table().splitlines() == [
        "scan  t   MAIN.mode", "0     0s  IDLE", "1     1s  FILL", "2     2s  HEAT"]


def scans(*rows: tuple[int, Changes]) -> Trace:
    """Return a run of which only the scans with these numbers changed something; 10 ms a scan."""
    trace = run_of(0, *((scan / 100, changes) for scan, changes in rows))
    trace.frames = [Frame(f.t_ns, scan, f.changes)
                    for f, (scan, _) in zip(trace.frames, rows, strict=True)]
    return trace


@pytest.mark.parametrize(("formula", "verdict"), [
    ("G (a -> X b)", "presumably satisfied"),
    ("G (rise(a) -> X (b & !a))", "presumably satisfied"),
    ("G (fall(a) -> X !b)", "violated"),
    ("G (fall(b) -> X a)", "violated"),
    ("X b", "satisfied"),
    ("G (c -> X c)", "violated"),
    ("AG (a -> AX b)", "presumably satisfied"),
])
def test_x_looks_at_the_next_scan_whether_or_not_it_left_a_frame(
        formula: str, verdict: str) -> None:
    trace = scans((0, {"a": True, "b": False, "c": False}), (1, {"a": False, "b": True}),
                  (5, {"b": False}), (6, {"c": True}), (9, {"c": False}))
    assert check(formula, trace).verdict == verdict


def test_the_distance_to_a_violation_is_told_in_the_unit_of_the_values() -> None:
    trace = run_of(9, (0, {"x": 3.0, "on": True}), (2, {"x": 7.5}), (4, {"x": 5.0}))
    assert check("G x < 8", trace).robustness == 0.5
    assert check("G x < 7", trace).robustness == -0.5
    assert check("G (on -> x >= 2 & x <= 10)", trace).robustness == 1.0
    assert check("F x > 7", trace).robustness == 0.5
    assert check("G on", trace).robustness is None
    assert check("G (!on -> x > 100)", trace).robustness is None


def test_what_is_owed_is_told_with_its_trigger_and_the_time_that_remains() -> None:
    trace = run_of(20, (0, {"p": False, "q": False}), (3, {"p": True}), (4, {"p": False}),
                   (7, {"p": True}))
    document = check("G (p -> F[0s,22s] q)", trace).as_json()
    assert document["obligations"] == [
        {"trigger_s": 3.0, "deadline_s": 25.0, "remaining_s": 5.0},
        {"trigger_s": 7.0, "deadline_s": 29.0, "remaining_s": 9.0}]
    late = check("G (p -> F[1s,22s] q)", trace).as_json()
    assert late["obligations"] == document["obligations"]
    assert check("G (p -> F q)", trace).obligations[0].deadline_ns is None


def test_only_errors_and_worse_fail_a_run() -> None:
    entries = parse_properties("a info: G x\nb \"why\" warning: G x\nc: G x\nd critical: G x")
    results = judge(run_of(1, (0, {"x": False})), entries)
    assert [(r.severity, r.failed) for r in results] == [
        (Severity.INFO, False), (Severity.WARNING, False), (Severity.ERROR, True),
        (Severity.CRITICAL, True)]


def test_a_violation_carries_an_excerpt_that_is_a_trace_of_its_own() -> None:
    rows = [(i / 100, {"n": i}) for i in range(1, 200)]
    trace = run_of(3, (0, {"n": 0, "other": True}), (0.005, {"other": False}), *rows)
    violation = check("G n < 150", trace).violation
    assert violation is not None and violation.excerpt is not None
    excerpt = violation.excerpt
    assert len(excerpt.frames) == 50
    assert dict(excerpt.frames[0].changes) == {0: 101, 1: False}
    assert excerpt.end_ns == violation.decided_at_ns
    assert check("G n < 150", excerpt).decided_at_ns == violation.decided_at_ns


def test_the_verdicts_alone_are_the_same_list_until_one_changes() -> None:
    trace = run_of(9, (0, {"p": False, "q": False}), (2, {"q": True}), (3, {"p": True}))
    suite = Suite(parse_properties("a: G !p\nb: F q\nc: G (p -> q)"), trace.tags)
    suite.observe(trace.frames[0])
    first = suite.verdicts()
    assert first == ["presumably satisfied", "presumably violated", "presumably satisfied"]
    assert suite.verdicts() is first
    suite.observe(trace.frames[1])
    suite.observe(trace.frames[2])
    assert suite.verdicts() == ["violated", "satisfied", "presumably satisfied"]
    assert first[0] == "presumably satisfied"


def test_a_copy_of_a_suite_goes_on_by_itself() -> None:
    trace = run_of(9, (0, {"p": False, "q": False}), (2, {"p": True}), (3, {"p": False}))
    suite = Suite(parse_properties("a: G (p -> F[1s,2s] q)\nb: G (p -> O[0s,1s] p)"), trace.tags)
    [suite.observe(frame) for frame in trace.frames[:2]]
    twin = suite.copy()
    suite.advance(8 * S)
    assert [r.verdict for r in twin.finish(3 * S)] == [
        "presumably violated", "presumably satisfied"]
    assert suite.results()[0].decided_at_ns == 4 * S
