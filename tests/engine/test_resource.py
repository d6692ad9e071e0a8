"""The resource: scans, tasks, clocks, states, snapshots and faults, in virtual time."""

import pytest
from controller import MS, Controller, main
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.base.errors import PlcemuError
from plcemu.engine.resource import Resource, State
from plcemu.ir.program import Task
from plcemu.lang.compile import compile_program

# ---------------------------------------------------------------- states

DIVIDES = main("a AT %IW0 : INT := 1; q AT %QX0.0 : BOOL; r AT %QW3 : INT; n : INT;",
               "q := TRUE;\nr := 100 / a;\nn := n + 1;")


def faulted(**options):
    controller = Controller(DIVIDES, **options).scan()
    controller["a"] = 0
    return controller.scan()


def test_a_program_fault_brings_the_resource_to_fault_with_its_place():
    fault = faulted().resource.fault
    assert (fault.reason, fault.task, fault.pou, fault.place, fault.t_ns) == (
        "division by zero", "main", "MAIN", "<text>:6:6", 10 * MS)
    assert str(fault) == "division by zero in MAIN at <text>:6:6 (task main, t = 0.010 s)"


def test_in_fault_outputs_are_safe_and_nothing_runs():
    controller = faulted()
    assert controller.resource.state is State.FAULT
    assert (controller["q"], controller["r"], controller.scan(3)["n"]) == (False, 0, 1)


def test_safe_outputs_may_be_other_values_than_zero():
    controller = faulted(safe_outputs={"q": True, "MAIN.r": -7})
    assert (controller["q"], controller["r"]) == (True, -7)


def test_outputs_are_safe_in_stop_and_live_again_after_resuming():
    controller = Controller(DIVIDES).scan()
    controller.resource.stop()
    assert (controller["q"], controller.scan()["n"]) == (False, 1)
    controller.resource.resume()
    assert (controller.scan()["q"], controller["n"]) == (True, 2)


def test_time_does_not_pass_for_timers_in_stop():
    controller = Controller(main("t : TON;", "t(IN := TRUE, PT := T#30ms);")).scan(2)
    controller.resource.stop()
    controller.scan(50)
    controller.resource.resume()
    assert controller.values(3, "Q") == [False, True, True]


def test_a_cold_start_sets_every_value_to_its_initial_one():
    controller = faulted()
    controller["a"] = 1
    controller.resource.restart(cold=True)
    assert (controller.resource.state, controller.resource.fault) == (State.RUN, None)
    assert controller.resource.snapshot() == controller.resource.program.layout.initial
    assert controller.scan()["n"] == 1


def test_a_fault_in_a_function_block_or_an_action_names_its_place():
    text = ("FUNCTION_BLOCK Inner VAR d : INT; END_VAR\nd := 1 MOD d;\nEND_FUNCTION_BLOCK\n"
            + main("f : Inner;", "INITIAL_STEP A: act(N); END_STEP\nACTION act: f(); END_ACTION"))
    fault = Controller(text).scan().resource.fault
    assert (fault.pou, fault.place) == ("Inner", "<text>:2:6")


def test_an_endless_jump_is_stopped_by_the_budget_in_every_scan_anew():
    controller = Controller(main("n : INT;", "l: LD n\nADD 1\nST n\nLD n\nLT 200\nJMPC l"),
                            budget=2000)
    assert controller.scan(3).resource.state is State.RUN
    controller = Controller(main("n : INT;", "WHILE TRUE DO n := n + 1; END_WHILE;"), budget=2000)
    assert "backwards cost over 2000" in controller.scan().resource.fault.reason


# ---------------------------------------------------------------- snapshots

MIXED = main("a AT %IX0.0 : BOOL; t : TON; c : CTU; q AT %QW0 : INT; r : REAL := 0.5;",
             "t(IN := a, PT := T#50ms); c(CU := t.Q, PV := 3); q := c.CV; r := r * 1.5 - 0.25;")


@given(st.lists(st.booleans(), min_size=2, max_size=30), st.data())
@settings(max_examples=40, deadline=None)
def test_a_restored_snapshot_runs_on_like_the_original(line, data):
    at = data.draw(st.integers(0, len(line) - 1))
    controller = Controller(MIXED)
    images = [image_after(controller, level) for level in line]
    controller.resource.restore(images[at])
    assert [image_after(controller, level) for level in line[at + 1:]] == images[at + 1:]


def image_after(controller, level):
    controller["a"] = level
    return controller.scan().resource.snapshot()


def test_an_image_of_another_program_is_refused():
    with pytest.raises(ValueError, match="it is of another program"):
        Controller(MIXED).resource.restore(b"1234")


def test_restoring_leaves_fault():
    controller = faulted()
    controller.resource.restore(controller.resource.program.layout.initial)
    assert controller.resource.state is State.RUN


def test_views_of_the_memory_block_stay_valid_over_a_restore():
    controller = Controller(MIXED)
    block = controller.resource.memory.block
    controller.resource.restore(controller.resource.snapshot())
    controller.resource.restart(cold=True)
    assert controller.resource.memory.block is block


# ---------------------------------------------------------------- tasks

THREE = "".join(f"PROGRAM {name} VAR_INPUT END_VAR VAR runs : INT; END_VAR runs := runs + 1;"
                f" %MW0 := %MW1; END_PROGRAM\n" for name in ("one", "two", "three"))
ORDER = "".join(f"PROGRAM p{d} VAR n AT %MD0 : DINT; END_VAR n := n * 10 + {d}; END_PROGRAM\n"
                for d in (1, 2, 3))


def run(text, tasks, instants):
    resource = Resource(compile_program(text), 10 * MS, tasks=tasks)
    for t_ns in instants:
        resource.scan(t_ns * MS)
    memory = resource.memory
    return {tag.name: memory.read(i) for i, tag in enumerate(memory.tags)}


def test_a_task_runs_at_its_releases_only():
    tasks = [Task("a", 20 * MS, 0, 0, ("one",)), Task("b", 30 * MS, 0, 10 * MS, ("two",)),
             Task("c", 0, 0, 0, ("THREE",))]
    found = run(THREE, tasks, range(0, 100, 10))
    assert [found[f"{p}.runs"] for p in ("one", "two", "three")] == [5, 3, 10]


@pytest.mark.parametrize(("priorities", "order"), [
    ((0, 0, 0), 123), ((2, 1, 0), 321), ((1, 0, 1), 213), ((5, 5, 1), 312)])
def test_tasks_released_together_run_by_priority_then_in_their_order(priorities, order):
    tasks = [Task(f"t{d}", 0, p, 0, (f"p{d}",)) for d, p in zip((1, 2, 3), priorities, strict=True)]
    assert run(ORDER, tasks, [0])["p1.n"] == order


def test_programs_of_one_task_run_in_the_order_it_names_them():
    assert run(ORDER, [Task("t", 0, 0, 0, ("p3", "p1", "p2"))], [0])["p1.n"] == 312


def test_without_tasks_all_programs_run_in_the_order_of_the_text():
    assert run(ORDER, None, [0])["p1.n"] == 123


def test_a_fault_keeps_less_urgent_tasks_from_running():
    text = ORDER + "PROGRAM bad VAR z : INT; END_VAR z := 1 / z; END_PROGRAM"
    tasks = [Task("b", 0, 1, 0, ("bad",)), Task("x", 0, 0, 0, ("p1",)), Task("y", 0, 2, 0, ("p2",))]
    assert run(text, tasks, [0])["p1.n"] == 1


def test_releases_are_found_and_counted():
    tasks = [Task("a", 20 * MS, 0, 5 * MS, ("p1",)), Task("b", 30 * MS, 0, 0, ("p2",))]
    resource = Resource(compile_program(ORDER), 10 * MS, tasks=tasks)
    found = [t for t in range(70) if resource.is_due(t * MS)]
    assert found == [0, 5, 25, 30, 45, 60, 65]
    assert [resource.first_release_ns(t * MS) // MS for t in (0, 1, 6, 31, 61)] == [0, 5, 25, 45,
                                                                                    65]
    assert resource.releases_between(0, 66 * MS) == 7


@given(st.integers(1, 50), st.integers(0, 50), st.integers(0, 200), st.integers(0, 200))
def test_releases_of_one_task_are_counted_like_one_by_one(interval, phase, first, length):
    resource = Resource(compile_program(ORDER), 10, tasks=[Task("a", interval, 0, phase, ("p1",))])
    expected = sum(resource.is_due(t) for t in range(first, first + length))
    assert resource.releases_between(first, first + length) == expected


@pytest.mark.parametrize(("options", "message"), [
    ({"engine": "steam"}, "no engine 'steam'"), ({"cycle_ns": 0}, "interval must be positive"),
    ({"tasks": [Task("t", -5, 0, 0, ("p1",))]}, "interval must be positive"),
    ({"tasks": [Task("t", 5, 0, -1, ("p1",))]}, "phase not negative"),
    ({"tasks": [Task("t", 5, 0, 0, ("p9",))]}, "there is no program 'p9'; there is p1, p2, p3"),
    ({"safe_outputs": {"nothing": 1}}, "there is no tag 'nothing'"),
    ({"safe_outputs": {"p1.n": 1 << 40}}, "safe output p1.n: .* outside the range of DINT"),
    ({"safe_outputs": {"p1.n": "on"}}, "safe output p1.n: "),
])
def test_wrong_settings_are_refused(options, message):
    with pytest.raises(PlcemuError, match=message):
        Resource(compile_program(ORDER), **{"cycle_ns": 10, **options})


# ---------------------------------------------------------------- quiet

PIECES = ["x := a AND NOT b;", "IF a THEN n := n + 1; END_IF;", "t(IN := a, PT := T#40ms);",
          "u(IN := b, PT := T#30ms);", "v(IN := x, PT := T#20ms);",
          "c(CU := t.Q, R := b, PV := 2);",
          "x := x XOR u.Q;", "IF n > 3 THEN n := 0; END_IF;", "b := v.Q;", "e(CLK := a);"]
DECLARED = "a AT %IX0.0, b, x : BOOL; n : INT; t : TON; u : TOF; v : TP; c : CTU; e : R_TRIG;"
CHART = ("INITIAL_STEP one: x(SD, T#20ms); END_STEP STEP two: b(L, T#30ms); END_STEP\n"
         "TRANSITION FROM one TO two := {}; END_TRANSITION\n"
         "TRANSITION FROM two TO one := NOT a; END_TRANSITION")
programs = st.lists(st.sampled_from(PIECES), min_size=1, max_size=5).map("\n".join) \
    | st.sampled_from(["a", "one.T > T#40ms", "a AND b"]).map(CHART.format)


@given(programs, st.lists(st.booleans(), min_size=1, max_size=25))
@settings(max_examples=120, deadline=None)
def test_while_quiet_further_scans_with_the_same_inputs_change_nothing(body, line):
    controller = Controller(main(DECLARED.replace("a AT %IX0.0, b", "a AT %IX0.0 : BOOL; b"), body))
    memory = controller.resource.memory
    for level in line:
        controller["a"] = level
        controller.scan()
        quiet = controller.resource.is_quiet()
        memory.changes()
        image = controller.resource.snapshot()
        controller.scan(5)
        assert not (quiet and memory.changes())
        controller.resource.restore(image)


def test_a_program_that_has_settled_is_quiet_and_wakes_when_memory_is_written():
    controller = Controller(main("a, x : BOOL;", "x := a;")).scan(2)
    assert controller.resource.is_quiet()
    controller["a"] = True
    assert not controller.resource.is_quiet()
    assert controller.scan(2).resource.is_quiet()


def test_a_running_timer_keeps_a_program_awake_and_an_expired_one_does_not():
    controller = Controller(main("t : TON;", "t(IN := TRUE, PT := T#30ms);"))
    quiet = [controller.scan().resource.is_quiet() for _ in range(6)]
    assert quiet == [False, False, False, False, True, True]


def test_the_unread_time_of_a_step_keeps_no_program_awake():
    text = main("x : BOOL;", "INITIAL_STEP A: x(N); END_STEP")
    assert Controller(text).scan(3).resource.is_quiet()
    text = main("x : BOOL;",
                "INITIAL_STEP A: x(N); END_STEP\n"
                "TRANSITION FROM A TO A := A.T > T#1d; END_TRANSITION")
    assert not Controller(text).scan(3).resource.is_quiet()


def test_a_slow_task_that_has_not_seen_a_change_keeps_the_resource_awake():
    text = ("PROGRAM fast VAR x : BOOL; END_VAR x := %MX0.0; END_PROGRAM\n"
            "PROGRAM slow VAR y : BOOL; END_VAR y := %MX0.0; END_PROGRAM")
    tasks = [Task("f", 10 * MS, 0, 0, ("fast",)), Task("s", 50 * MS, 0, 0, ("slow",))]
    controller = Controller(text, tasks=tasks).scan(11)
    assert controller.resource.is_quiet()
    controller["%MX0.0"] = True
    quiet = [controller.scan().resource.is_quiet() for _ in range(11)]
    assert (quiet, controller["y"]) == ([False] * 9 + [True] * 2, True)


def test_outside_of_run_everything_is_quiet():
    assert faulted().resource.is_quiet()
    controller = Controller(MIXED)
    controller.resource.stop()
    assert controller.resource.is_quiet()


# ---------------------------------------------------------------- memory


def test_changes_tell_each_changed_tag_once_in_order():
    controller = Controller(main("a, b : INT; x : REAL; y : BOOL;", "b := b + 1; x := 0.5;"))
    memory = controller.resource.memory
    assert memory.values() == ((0, 0), (1, 0), (2, 0.0), (3, False))
    controller.scan()
    assert memory.changes() == ((1, 1), (2, 0.5))
    controller.scan()
    assert memory.changes() == ((1, 2),)
    assert memory.changes() == ()


def test_two_tags_at_one_address_change_together():
    controller = Controller(main("a AT %MW0 : INT; b AT %MW0 : WORD;", "a := -1;")).scan()
    assert controller.resource.memory.changes() == ((0, -1), (1, 65535))


@given(st.integers(0, 100), st.lists(st.integers(0, 50), max_size=8))
def test_clocks_advance_up_to_their_limit_and_never_beyond(limit, steps):
    controller = Controller(main("t : TON; pt : TIME;", "t(IN := TRUE, PT := pt);"), 1)
    controller["MAIN.pt"] = limit
    controller.resource.scan(0)
    now = 0
    for step in steps:
        now += step
        controller.resource.scan(now)
        assert (controller["ET"], controller["Q"]) == (min(now, limit), now >= limit)


def test_time_that_goes_back_counts_as_none():
    controller = Controller(main("t : TON;", "t(IN := TRUE, PT := T#1s);"))
    for t_ns in (100 * MS, 50 * MS, 60 * MS):
        controller.resource.scan(t_ns)
    assert controller["ET"] == 10 * MS


def test_a_program_instance_is_found_by_name_in_any_case():
    program = compile_program(ORDER)
    assert program.instance("P2").name == "p2"
    with pytest.raises(KeyError):
        program.instance("p9")
