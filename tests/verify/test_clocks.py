"""What a program can see of its clocks, found in the compiled program."""

from __future__ import annotations

import pytest

from plcemu.lang.compile import compile_program
from plcemu.verify.cone import cone_of
from plcemu.verify.timed.clocks import Lookout, lookout

MS = 1_000_000
S = 1_000 * MS
TIMER = "t(IN := i, PT := T#1s); q := t.Q;"


def seen(body: str, *asked: str) -> Lookout:
    """What is seen of the clocks that the output q, or other variables, depend on."""
    program = compile_program("PROGRAM MAIN VAR i AT %IX0.0 : BOOL; w AT %IL0 : LINT; q AT %QX0.0 "
                              ": BOOL; n : LINT; r : LREAL; x, y : TIME; s, t : TON; u : TP; "
                              f"v : TOF; many : ARRAY[1..2] OF TON; END_VAR {body} END_PROGRAM")
    names = {f"MAIN.{name}" for name in asked or ("q",)}
    return lookout(program, cone_of(program, [s.offset for s in program.layout.slots
                                              if s.tag.name in names]))


@pytest.mark.parametrize(("body", "thresholds"), [
    (TIMER, {"MAIN.t": [S]}),
    ("t(IN := i, PT := T#1s); u(IN := t.Q, PT := T#2s); v(IN := u.Q, PT := T#3s); q := v.Q;",
     {"MAIN.t": [S], "MAIN.u": [2 * S], "MAIN.v": [3 * S]}),
    ("IF i THEN x := T#2s; ELSE x := T#3s + T#1ms; END_IF; t(IN := i, PT := x); q := t.Q;",
     {"MAIN.t": [2 * S, 3 * S + MS]}),
    ("t(IN := i, PT := T#1s); q := t.ET >= T#300ms AND t.ET < T#600ms;",
     {"MAIN.t": [300 * MS, 600 * MS, S]}),
    ("t(IN := i, PT := T#1s); q := t.ET > T#300ms AND NOT (t.ET <= T#600ms);",
     {"MAIN.t": [300 * MS + 1, 600 * MS + 1, S]}),
    ("t(IN := i, PT := T#1s); q := T#300ms <= t.ET OR T#600ms < t.ET;",
     {"MAIN.t": [300 * MS, 600 * MS + 1, S]}),
    ("t(IN := i, PT := T#1s); x := t.ET; y := x; q := y >= T#200ms;",
     {"MAIN.t": [200 * MS, S]}),
    ("t(IN := i, PT := T#1s); x := SEL(i, t.ET, T#5s); q := x >= T#200ms;",
     {"MAIN.t": [200 * MS, S]}),
    ("many[1](IN := i, PT := T#1s); many[2](IN := many[1].Q, PT := T#2s); q := many[2].Q;",
     {"MAIN.many[1]": [S], "MAIN.many[2]": [2 * S]}),
])
def test_the_constants_that_elapsed_times_are_compared_with(
        body: str, thresholds: dict[str, list[int]]) -> None:
    found = seen(body)
    assert found.problems == ()
    assert {c.name: list(c.thresholds) for c in found.clocks} == thresholds


@pytest.mark.parametrize(("body", "told"), [
    ("t(IN := i, PT := T#1s); x := t.ET * 2; q := x > T#1s;", "calculates with MAIN.t"),
    ("t(IN := i, PT := T#1s); n := TIME_TO_LINT(t.ET); q := n MOD 2 = 0;",
     "calculates with MAIN.t"),
    ("t(IN := i, PT := T#1s); q := t.ET = T#500ms;", "equal to a value"),
    ("t(IN := i, PT := T#1s); s(IN := i, PT := T#2s); q := t.ET < s.ET;",
     "compares MAIN.t with MAIN.s"),
    ("x := x + T#1ms; t(IN := i, PT := x); q := t.Q;", "not constant"),
    ("x := LINT_TO_TIME(w); t(IN := i, PT := x); q := t.Q;", "not constant"),
    ("t(IN := i, PT := T#1s); q := t.ET > T#0s;", "the first instant"),
    ("t(IN := i, PT := T#1s); s(IN := i, PT := t.ET); q := s.Q;", "MAIN.s"),
])
def test_whatever_else_is_done_with_an_elapsed_time_is_named(body: str, told: str) -> None:
    assert any(told in problem for problem in seen(body).problems)


def test_a_problem_says_where_it_is() -> None:
    problem, = seen("t(IN := i, PT := T#1s);\nq := t.ET = T#500ms;").problems
    assert problem.startswith("<text>:2:")


def test_what_nothing_asked_about_depends_on_is_no_problem() -> None:
    found = seen(TIMER + " x := t.ET * 2;")
    assert found.problems == () and [c.name for c in found.clocks] == ["MAIN.t"]


def test_calculating_with_it_is_a_problem_where_it_is_asked_about() -> None:
    assert seen(TIMER + " x := t.ET * 2;", "x").problems


CHART = """PROGRAM MAIN
VAR i AT %IX0.0 : BOOL; q AT %QX0.0 : BOOL; END_VAR
INITIAL_STEP A: END_STEP
STEP B: q(N); END_STEP
TRANSITION FROM A TO B := A.T >= T#5s; END_TRANSITION
TRANSITION FROM B TO A := {condition}; END_TRANSITION
END_PROGRAM
"""


@pytest.mark.parametrize(("condition", "thresholds"), [
    ("B.T > T#1s", {"MAIN.A.T": (5 * S,), "MAIN.B.T": (S + 1,)}),
    ("i", {"MAIN.A.T": (5 * S,)})])
def test_step_times_are_seen_where_a_transition_asks_for_them(
        condition: str, thresholds: dict[str, tuple[int, ...]]) -> None:
    program = compile_program(CHART.format(condition=condition))
    q = next(s.offset for s in program.layout.slots if s.tag.name == "MAIN.q")
    found = lookout(program, cone_of(program, [q]))
    assert {c.name: c.thresholds for c in found.clocks} == thresholds and not found.problems


def test_where_memory_is_reached_in_unknown_ways_nothing_is_told() -> None:
    assert lookout(compile_program(CHART.format(condition="i")), None).problems
