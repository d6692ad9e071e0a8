"""Tasks in the cycle: what each misses, what is told of them; commands; state to clients."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path

import pytest
from systems import MS, S, system_of

import plcemu
from plcemu.base.errors import ConfigError
from plcemu.base.trace import Frame, Trace
from plcemu.engine.resource import Resource
from plcemu.ir.program import Task
from plcemu.lang.compile import compile_program
from plcemu.modbus import FAULT_OBJECT, STATE_OBJECT, Identity
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.plc import make_exchange
from plcemu.runtime.wiring import make_tasks

TWO = ("PROGRAM one VAR n : INT; END_VAR n := n + 1; END_PROGRAM\n"
       "PROGRAM two VAR n : INT; state : INT := 7; END_VAR n := n + 1; END_PROGRAM\n")
FAST = Task("fast", 10 * MS, 0, 0, ("one",))
SLOW = Task("slow", 100 * MS, 1, 0, ("two",))


class Laps:
    """A clock that jumps to what is slept for; as an observer it lets laps take their time."""

    def __init__(self, lap_ns: dict[int, int]) -> None:
        self._lap_ns, self._now_ns = lap_ns, 0

    def now_ns(self) -> int:
        return self._now_ns

    def observe(self, frame: Frame) -> None:
        self._now_ns += self._lap_ns.get(frame.t_ns, 0)

    async def sleep_until_ns(self, t_ns: int) -> None:
        self._now_ns = max(self._now_ns, t_ns)
        await asyncio.sleep(0)


def cycle_of(text: str, tasks: Sequence[Task] = (), **options: object) -> Cycle:
    resource = Resource(compile_program(text), 10 * MS, tasks=tasks or None,
                        **options)  # type: ignore[arg-type]
    return Cycle(resource, make_exchange(resource))


def run(cycle: Cycle, lap_ns: dict[int, int], until_ns: int) -> Cycle:
    clock = Laps(lap_ns)
    cycle.observers.append(clock)
    asyncio.run(cycle.run(clock, asyncio.Event(), until_ns))
    return cycle


def told(cycle: Cycle, *names: str) -> list[object]:
    values = cycle.values()
    return [values[cycle.tags.find(name)] for name in names]


def test_a_task_overruns_when_a_release_of_its_own_passes() -> None:
    cycle = run(cycle_of(TWO, [FAST, SLOW]), {100 * MS: 35 * MS}, 300 * MS)
    assert told(cycle, "task.fast.overruns", "task.fast.missed", "task.slow.overruns",
                "task.slow.missed", "task.overruns", "task.missed") == [1, 3, 0, 0, 1, 3]
    assert told(cycle, "task.fast.scans", "task.slow.scans") == [27, 3]


def test_a_long_lap_makes_every_task_miss_its_own_releases() -> None:
    cycle = run(cycle_of(TWO, [FAST, SLOW]), {0: 205 * MS}, 300 * MS)
    assert told(cycle, "task.fast.missed", "task.slow.missed", "task.missed") == [20, 2, 20]


def test_statistics_of_tasks_are_shown_once_a_second() -> None:
    cycle = cycle_of(TWO, [FAST, SLOW])
    trace = Trace(cycle.tags)
    cycle.observers.append(trace)
    run(cycle, {}, 3 * S)
    shown = [t / S for t, _ in trace.history("task.fast.scans")]
    assert shown == [0, 0.01, 1.01, 2.01]


def test_execution_and_lateness_are_measured_by_the_clock_of_the_cycle() -> None:
    resource = Resource(compile_program(TWO), 10 * MS, tasks=[FAST, SLOW])
    resource.scan(0, iter((5, 25, 40, 47)).__next__)
    fast, slow = resource.statistics
    assert [s.execution.last_ns for s in (fast, slow)] == [20, 7]
    assert [s.lateness.last_ns for s in (fast, slow)] == [5, 40]


@pytest.mark.parametrize("dense", [True, False])
def test_in_virtual_time_times_are_0_and_scans_count_what_is_passed_over(dense: bool) -> None:
    cycle = cycle_of(TWO.replace("n := n + 1;", ""), [FAST, SLOW])
    cycle.run_virtual(2 * S, dense=dense)
    assert told(cycle, "task.fast.scans", "task.slow.scans") == [200, 20]
    assert told(cycle, "task.fast.execution_max", "task.fast.lateness_p99") == [0, 0]


def test_a_task_may_be_called_like_a_counter_of_the_cycle() -> None:
    cycle = cycle_of(TWO, [Task("overruns", programs=("one",)), Task("missed", programs=("two",))])
    assert told(cycle, "task.overruns", "task.overruns.missed") == [0, 0]


def test_a_program_s_variable_goes_before_the_plc_s_own_tags() -> None:
    cycle = cycle_of(TWO)
    assert told(cycle, "state", "resource.state", "fault") == [7, "RUN", ""]


def test_two_tasks_of_one_name_are_refused() -> None:
    with pytest.raises(plcemu.base.errors.PlcemuError, match="two tasks FAST"):
        cycle_of(TWO, [FAST, Task("FAST", programs=("two",))])


# commands


def test_commands_within_a_lap_wait_for_its_end() -> None:
    cycle = cycle_of(TWO)
    seen: list[str] = []

    class Stopper:
        def observe(self, frame: Frame) -> None:
            cycle.stop()
            seen.append(cycle.resource.state.value)

    cycle.observers.append(Stopper())
    cycle.lap()
    assert (seen, cycle.resource.state.value) == (["RUN"], "STOP")


def test_state_and_fault_are_tags_of_the_trace() -> None:
    plc = plcemu.Plc("PROGRAM p VAR a AT %IX0.0 : BOOL; END_VAR WHILE a DO ; END_WHILE; "
                     "END_PROGRAM", record=True, budget=100)
    plc.scan()
    plc["a"] = True
    plc.scan()
    plc["a"] = False
    plc.restart()
    plc.scan()
    plc.stop()
    plc.scan()
    plc.resume()
    plc.scan()
    assert plc.trace.history("resource.state") == [
        (0, "RUN"), (10 * MS, "FAULT"), (20 * MS, "RUN"), (30 * MS, "STOP"), (40 * MS, "RUN")]
    reasons = [reason for _, reason in plc.trace.history("resource.fault")]
    assert [bool(reason) for reason in reasons] == [False, True, False]
    assert "does not end" in str(reasons[1])


def test_clients_see_state_and_reason_in_the_identification_as_they_are_now() -> None:
    state, fault = ["RUN"], [""]
    identity = Identity(extended={STATE_OBJECT: lambda: state[0], FAULT_OBJECT: lambda: fault[0]})
    assert list(identity.objects) == [0, 1, 2, STATE_OBJECT]
    state[0], fault[0] = "FAULT", "Störung" * 99
    assert identity.objects[STATE_OBJECT] == b"FAULT"
    assert identity.objects[FAULT_OBJECT].startswith(b"St?rung") and \
        len(identity.objects[FAULT_OBJECT]) == 244


# configuration


def test_tasks_of_the_program_text_are_changed_by_their_names(tmp_path: Path) -> None:
    text = ("PROGRAM MAIN VAR n : INT; END_VAR n := n + 1; END_PROGRAM CONFIGURATION c RESOURCE r "
            "ON plc TASK t(INTERVAL := T#20ms, PRIORITY := 3); PROGRAM p WITH t : MAIN; "
            "END_RESOURCE END_CONFIGURATION")
    system = system_of(tmp_path, "watchdog: 1s\nbudget: 500\ntasks:\n  T: {budget: 70, phase: 5ms}",
                       text)
    (task,) = make_tasks(system.config, compile_program(text))
    assert (task.name, task.interval_ns, task.priority, task.phase_ns, task.budget,
            task.watchdog_ns, task.programs) == ("t", 20 * MS, 3, 5 * MS, 70, S, ("p",))


@pytest.mark.parametrize(("tasks", "said"), [
    ("  x: {budget: 5}",
     "tasks.x: names no programs, and is no task of the program text; there is main"),
    ("  x: {programs: MAIN}", "tasks.x.interval: is missing"),
    ("  x: {interval: 1s, programs: MAIN}\n  X: {interval: 1s, programs: MAIN}",
     "tasks: two tasks have one name")])
def test_tasks_that_do_not_fit_are_told(tmp_path: Path, tasks: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        system_of(tmp_path, f"tasks:\n{tasks}\n")
