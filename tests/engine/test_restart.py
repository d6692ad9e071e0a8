"""Stop, resume, cold and warm restart; budgets and watchdogs."""

import pytest
from controller import MS, Controller, main

from plcemu.engine.resource import Resource, State
from plcemu.ir.program import Task
from plcemu.lang.compile import compile_program

KEEPS = ("PROGRAM MAIN VAR RETAIN kept : INT := 3; END_VAR VAR lost : INT := 5; "
         "a AT %IX0.0 : BOOL; q AT %QW0 : INT := 9; m AT %MW0 : INT := 8; END_VAR "
         "kept := kept + 1; lost := lost + 1; q := q + 1; m := m + 1; END_PROGRAM")


def after(cold):
    controller = Controller(KEEPS).scan(3)
    controller["a"] = True
    controller.resource.restart(cold)
    return controller


def shown(controller):
    return [controller[name] for name in ("kept", "lost", "q", "m", "a")]


def test_after_a_cold_restart_all_is_initial_but_the_inputs():
    assert shown(after(cold=True)) == [3, 5, 9, 8, True]


def test_after_a_warm_restart_retained_variables_keep_their_values():
    assert shown(after(cold=False)) == [6, 5, 9, 8, True]


@pytest.mark.parametrize("cold", [True, False])
def test_a_restart_is_possible_from_any_state(cold):
    controller = after(cold)
    controller.resource.stop()
    controller.resource.restart(cold)
    assert controller.scan().resource.state is State.RUN


@pytest.mark.parametrize("cold", [True, False])
def test_the_scan_after_a_restart_is_a_first_scan(cold):
    text = main("x, y : INT; t : TON;",
                "INITIAL_STEP A: enter(P1); stay(N); END_STEP STEP B: END_STEP\n"
                "TRANSITION FROM A TO B := TRUE; END_TRANSITION\n"
                "ACTION enter: x := x + 1; END_ACTION\n"
                "ACTION stay: t(IN := TRUE, PT := T#1s); y := y + 1; END_ACTION")
    first = Controller(text).scan()
    again = Controller(text).scan(7)
    again.resource.restart(cold)
    assert again.scan().resource.snapshot() == first.resource.snapshot()
    assert again.scan().resource.snapshot() == first.scan().resource.snapshot()


def test_no_time_passes_for_a_retained_timer_between_the_scans_around_a_restart():
    controller = Controller("PROGRAM MAIN VAR RETAIN t : TON; END_VAR t(IN := TRUE, PT := T#1s); "
                            "END_PROGRAM").scan(3)
    controller.resource.stop()
    controller.scan(20)
    controller.resource.restart(cold=False)
    assert controller.values(2, "ET") == [20 * MS, 30 * MS]


# ---------------------------------------------------------------- budgets

COUNTS = "PROGRAM {0} VAR {0}_n : INT; END_VAR {1} END_PROGRAM\n"
LOOP = "WHILE {0}_n MOD {1} <> {1} - 1 DO {0}_n := {0}_n + 1; END_WHILE; {0}_n := {0}_n + 1;"
BOTH = COUNTS.format("a", LOOP.format("a", 20)) + COUNTS.format("b", LOOP.format("b", 60))
RUNAWAYS = {"an endless jump": "x: LD n\nADD 1\nST n\nJMP x",
            "an endless loop": "WHILE TRUE DO n := n + 1; END_WHILE;",
            "an endless repeat": "REPEAT n := n + 1; UNTIL FALSE END_REPEAT;",
            "a count that never ends": "FOR i := 0 TO 10 BY 0 DO n := n + 1; END_FOR;"}


def state_of(*tasks, **options):
    resource = Resource(compile_program(BOTH), 10 * MS, tasks=tasks, **options)
    resource.scan(0)
    return resource.state, resource.fault and resource.fault.task


@pytest.mark.parametrize("body", RUNAWAYS.values(), ids=RUNAWAYS)
def test_what_runs_away_ends_in_fault_with_safe_outputs(body):
    controller = Controller(main("n : DINT; i : INT; q AT %QX0.0 : BOOL := TRUE;", body),
                            budget=5000, safe_outputs={"q": False}).scan()
    assert (controller.resource.state, controller["q"]) == (State.FAULT, False)
    assert "does not end: jumps backwards cost over 5000" in str(controller.resource.fault)


def test_a_task_s_own_budget_takes_the_place_of_the_common_one():
    assert state_of(Task("a", programs=("a",)), Task("b", programs=("b",)), budget=400) == (
        State.FAULT, "b")
    assert state_of(Task("a", programs=("a",)), Task("b", programs=("b",), budget=5000),
                    budget=400)[0] is State.RUN
    assert state_of(Task("a", programs=("a",), budget=20), Task("b", programs=("b",))) == (
        State.FAULT, "a")


def test_the_programs_of_a_task_share_its_budget():
    costs = [next(n for n in range(2000) if state_of(Task("t", programs=names, budget=n + 1))[0]
                  is State.RUN) + 1 for names in (("a",), ("b",), ("a", "b"))]
    assert costs[2] == costs[0] + costs[1]


# ---------------------------------------------------------------- watchdogs


def watched(took_ns, watchdog_ns):
    task = Task("t", programs=("a", "b"), watchdog_ns=watchdog_ns)
    resource = Resource(compile_program(BOTH), 10 * MS, tasks=[task])
    resource.scan(0, iter((0, took_ns)).__next__)
    return resource


def test_a_run_that_takes_longer_than_its_watchdog_ends_in_fault():
    resource = watched(3 * MS + 1, 3 * MS)
    assert resource.state is State.FAULT
    assert str(resource.fault) == ("the task took 3.000001ms, its watchdog allows 3ms "
                                   "(task t, t = 0.000 s)")


@pytest.mark.parametrize(("took", "watchdog"), [(3 * MS, 3 * MS), (10**12, 0)])
def test_a_run_within_its_watchdog_or_without_one_is_fine(took, watchdog):
    assert watched(took, watchdog).state is State.RUN


def test_without_a_clock_no_watchdog_bites():
    task = Task("t", programs=("a",), watchdog_ns=1)
    resource = Resource(compile_program(BOTH), 10 * MS, tasks=[task])
    resource.scan(0)
    assert resource.state is State.RUN
