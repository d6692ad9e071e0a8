"""The cycle: order of phases, jumping in virtual time, deadlines and overruns in real time."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from itertools import chain, repeat
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from systems import MS, STARTER, S, batch_system, system_of

from plcemu.base.errors import ConfigError
from plcemu.base.trace import Change, Frame, Trace
from plcemu.base.tracefile import save
from plcemu.engine.resource import Resource, State
from plcemu.io.exchange import Exchange
from plcemu.lang.compile import compile_program
from plcemu.monitor import parse_properties
from plcemu.runtime.change import make_exchange
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.plc import Plc
from plcemu.runtime.system import System

TWO_SPEEDS = """PROGRAM FAST
VAR button AT %IX0.0 : BOOL; lamp AT %QX0.0 : BOOL; blink : TON; END_VAR
  CAL blink(IN := button, PT := T#730ms)
  LD blink.Q
  ST lamp
END_PROGRAM
PROGRAM SLOW
VAR lamp AT %QX0.0 : BOOL; seen : INT; old : BOOL; END_VAR
  LD lamp
  ANDN old
  JMPCN over
  LD seen
  ADD 1
  ST seen
over:
  LD lamp
  ST old
END_PROGRAM
"""


def traced(system: System) -> Trace:
    trace = Trace(system.cycle.tags)
    system.cycle.observers.append(trace)
    return trace


def run_of(system: System, until_ns: int, *, dense: bool) -> Trace:
    trace = traced(system)
    system.cycle.run_virtual(until_ns, dense=dense)
    trace.end_ns = system.cycle.end_ns
    return trace


def cycle_of(text: str, cycle_ns: int = 10 * MS, properties: str = "") -> Cycle:
    resource = Resource(compile_program(text), cycle_ns)
    return Cycle(resource, make_exchange(resource), None, parse_properties(properties))


# phases


class Witness:
    """Notes what the exchange shows while an observer is told of a scan."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange
        self.seen: list[tuple[int, bytes]] = []

    def observe(self, frame: Frame) -> None:
        self.seen.append((frame.t_ns, self._exchange.published("QW", 2, 2)))


def test_observers_see_published_outputs_of_the_scan_they_are_told_of() -> None:
    cycle = cycle_of(STARTER)
    witness = Witness(cycle.exchange)
    cycle.observers.append(witness)
    port = cycle.exchange.port("client")
    for value in (1, 2, 3):
        port.write("IW", 2, value.to_bytes(2, "big"))
        cycle.lap()
    assert witness.seen == [(0, b"\0\1"), (10 * MS, b"\0\2"), (20 * MS, b"\0\3")]


def test_writes_of_one_moment_are_latched_together() -> None:
    cycle = cycle_of(STARTER)
    cycle.lap()
    port = cycle.exchange.port("client")
    port.write("IX", 0, b"\1")
    port.write("IW", 2, b"\0\7")
    before = cycle.resource.snapshot()
    assert cycle.resource.memory.block == before
    cycle.lap()
    memory = cycle.resource.memory
    values = {t.name: memory.read(i) for i, t in enumerate(memory.tags)}
    assert (values["MAIN.start"], values["MAIN.level"], values["MAIN.speed"]) == (True, 7, 7)


def test_a_client_reads_old_values_until_the_scan_is_over() -> None:
    cycle = cycle_of(STARTER)
    writer, reader = cycle.exchange.port("writer"), cycle.exchange.port("reader")
    writer.write("IW", 2, b"\0\7")
    assert (writer.read("IW", 2, 2), reader.read("IW", 2, 2)) == (b"\0\7", b"\0\0")
    cycle.lap()
    assert reader.read("IW", 2, 2) == reader.read("QW", 2, 2) == b"\0\7"


def test_the_plant_follows_outputs_of_a_scan_from_its_instant_on() -> None:
    system = batch_system("load=1")
    log: list[tuple[int, str]] = []
    plant = system.plant
    assert plant is not None
    for phase in ("before_scan", "after_scan"):
        _note(log, plant, phase, system)
    _note(log, system.resource, "scan", system)
    _note(log, system.exchange, "update_inputs", system)
    _note(log, system.exchange, "update_outputs", system)
    system.cycle.lap()
    assert [name for _, name in log] == ["before_scan", "update_inputs", "scan", "update_outputs",
                                         "after_scan"]


def _note(log: list[tuple[int, str]], holder: object, name: str, system: System) -> None:
    """Let calls of a method be noted in a log."""
    method = getattr(holder, name)

    def noted(*arguments: object) -> object:
        log.append((system.cycle.t_ns, name))
        return method(*arguments)
    setattr(holder, name, noted)


def test_verdicts_join_the_frame_that_decides_them() -> None:
    cycle = cycle_of(STARTER, properties="never: G !start")
    trace = Trace(cycle.tags)
    cycle.observers.append(trace)
    cycle.lap()
    cycle.exchange.port("client").write("IX", 0, b"\1")
    cycle.lap()
    assert trace.history("monitor.never.verdict") == [
        (0, "presumably satisfied"), (10 * MS, "violated")]


def test_a_verdict_that_falls_with_time_alone_is_in_the_trace() -> None:
    cycle = cycle_of(STARTER, properties="soon: F[0s,3s] pump")
    trace = Trace(cycle.tags)
    cycle.observers.append(trace)
    cycle.run_virtual(10 * S)
    assert trace.history("monitor.soon.verdict") == [
        (0, "presumably violated"), (3 * S, "violated")]
    assert cycle.suite.results()[0].decided_at_ns == 3 * S


# jumping


@pytest.mark.parametrize("overrides", [("load=1",), ("load=2", "time_scale=7"), ("load=6.5",),
                                       ("load=7.5",), ("load=0",)])
def test_skipping_leaves_the_trace_of_the_batch_plant_as_it_is(overrides: Sequence[str],
                                                               tmp_path: Path) -> None:
    runs = {}
    for dense in (True, False):
        system = batch_system(*overrides, "cycle=200ms")
        runs[dense] = trace = run_of(system, 700 * S, dense=dense)
        save(trace, tmp_path / f"{dense}.jsonl")
    assert runs[True].frames == runs[False].frames
    assert runs[True].end_ns == runs[False].end_ns
    assert (tmp_path / "True.jsonl").read_bytes() == (tmp_path / "False.jsonl").read_bytes()


def test_skipping_passes_over_most_scans_of_the_batch_plant() -> None:
    system = batch_system("load=2", "cycle=100ms")
    system.cycle.run_virtual(2000 * S)
    counters = system.cycle.counters
    assert counters.laps + counters.skipped == system.cycle.scan_number == 20_000
    assert counters.laps < 2000


def test_reports_of_dense_and_skipping_runs_differ_only_in_the_laps_executed() -> None:
    reports = []
    for dense in (True, False):
        system = batch_system("load=2", "cycle=200ms")
        system.cycle.run_virtual(650 * S, dense=dense)
        reports.append(system.report() | {"executed": 0})
    assert reports[0] == reports[1]


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 400), st.booleans()), min_size=1, max_size=6),
       st.sampled_from([1, 7, 10, 30]))
def test_skipping_leaves_the_trace_of_timers_as_it_is(writes: list[tuple[int, bool]],
                                                      cycle_ms: int) -> None:
    program = compile_program(STARTER)
    traces = []
    for dense in (True, False):
        plc = Plc(program, cycle_ms * MS, record=True)
        for after_10ms, value in writes:
            plc._cycle.run_virtual(plc.t_ns + after_10ms * 10 * MS, dense=dense)
            plc["start"] = value
        plc._cycle.run_virtual(plc.t_ns + 3 * S, dense=dense)
        traces.append((plc.trace.frames, plc.trace.end_ns, plc.snapshot()))
    assert traces[0] == traces[1]


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 300), min_size=1, max_size=5), st.sampled_from([3, 10, 70]),
       st.sampled_from([5, 70, 110]), st.integers(0, 9))
def test_skipping_leaves_the_trace_of_two_tasks_as_it_is(pauses: list[int], fast_ms: int,
                                                         slow_ms: int, phase_ms: int) -> None:
    from plcemu.ir.program import Task
    program = compile_program(TWO_SPEEDS)
    tasks = [Task("fast", fast_ms * MS, 0, 0, ("FAST",)),
             Task("slow", slow_ms * MS, 1, phase_ms * MS, ("SLOW",))]
    traces = []
    for dense in (True, False):
        plc = Plc(program, record=True, tasks=tasks)
        for n, pause in enumerate(pauses):
            plc["button"] = n % 2 == 0
            plc._cycle.run_virtual(plc.t_ns + pause * 10 * MS, dense=dense)
        plc._cycle.run_virtual(plc.t_ns + 2 * S, dense=dense)
        traces.append((plc.trace.frames, plc.trace.end_ns, plc.snapshot(), plc.t_ns))
    assert traces[0] == traces[1]


def test_a_fault_is_at_the_same_instant_dense_or_not() -> None:
    text = STARTER.replace("  LD  delay.Q\n", "  LD  delay.Q\n  JMPCN fine\n  LD 1\n  DIV count\n"
                           "  ST count\n  LD 0\n  ST count\n  LD 1\n  DIV count\nfine:\n"
                           "  LD delay.Q\n")
    ends = []
    for dense in (True, False):
        plc = Plc(text, record=True)
        plc["start"] = True
        plc._cycle.run_virtual(5 * S, dense=dense)
        ends.append((plc.state, plc.fault, plc.trace.frames))
    assert ends[0] == ends[1]
    assert ends[0][0] == "FAULT" and "t = 2.000 s" in ends[0][1]


# the end of a run


def test_a_run_ends_exactly_where_it_was_told_to() -> None:
    cycle = cycle_of(STARTER, 7 * MS)
    cycle.run_virtual(10 * MS)
    assert (cycle.now_ns, cycle.end_ns, cycle.t_ns) == (10 * MS, 10 * MS, 14 * MS)


def test_the_release_at_the_end_of_a_run_belongs_to_the_next_run() -> None:
    cycle = cycle_of(STARTER, properties="soon: F[0s,1s] pump")
    cycle.run_virtual(1 * S)
    assert cycle.suite.results()[0].verdict == "presumably violated"
    cycle.run_virtual(2 * S)
    assert cycle.suite.results()[0].verdict == "violated"


def test_the_plant_stands_where_the_run_ended() -> None:
    system = batch_system("load=1", "time_scale=3", "cycle=70ms")
    system.cycle.run_virtual(100 * S)
    assert system.report()["plant"]["t_s"] == 300.0
    assert system.report()["t_s"] == 100.0


# real time, by a scripted clock


class ScriptedClock:
    """A clock that jumps to what is slept for, and as an observer of laps lets each take its time.

    Args:
        lap_ns: how long the laps take, the last one repeated.
        late_ns: how late sleeps end.
    """

    def __init__(self, lap_ns: Sequence[int], late_ns: int = 0) -> None:
        self._laps = chain(lap_ns, repeat(lap_ns[-1]))
        self._late_ns = late_ns
        self._now_ns = 0

    def now_ns(self) -> int:
        return self._now_ns

    def observe(self, frame: Frame) -> None:
        self._now_ns += next(self._laps)

    async def sleep_until_ns(self, t_ns: int) -> None:
        self._now_ns = max(self._now_ns, t_ns) + self._late_ns
        await asyncio.sleep(0)


class Releases:
    """Notes the instants of scans."""

    def __init__(self) -> None:
        self.t_ms: list[float] = []

    def observe(self, frame: Frame) -> None:
        self.t_ms.append(frame.t_ns / MS)


def real_run(cycle: Cycle, clock: ScriptedClock, until_ns: int) -> list[float]:
    releases = Releases()
    cycle.observers += [releases, clock]
    asyncio.run(cycle.run(clock, asyncio.Event(), until_ns))
    return releases.t_ms


def test_laps_in_time_keep_the_releases() -> None:
    cycle = cycle_of(STARTER)
    assert real_run(cycle, ScriptedClock([3 * MS], late_ns=1 * MS), 50 * MS) == [0, 10, 20, 30, 40]
    counters = cycle.counters
    assert (counters.overruns, counters.missed) == (0, 0)
    assert (counters.max_late_ns, counters.max_lap_ns) == (1 * MS, 3 * MS)


def test_a_lap_that_ends_at_the_next_release_is_no_overrun() -> None:
    cycle = cycle_of(STARTER)
    assert real_run(cycle, ScriptedClock([10 * MS]), 40 * MS) == [0, 10, 20, 30]
    assert (cycle.counters.overruns, cycle.counters.missed) == (0, 0)


def test_an_overrun_is_counted_and_its_missed_releases_are_skipped() -> None:
    cycle = cycle_of(STARTER)
    clock = ScriptedClock([1 * MS, 35 * MS, 1 * MS])
    assert real_run(cycle, clock, 100 * MS) == [0, 10, 50, 60, 70, 80, 90]
    assert (cycle.counters.overruns, cycle.counters.missed) == (1, 3)
    assert cycle.scan_number == 7


def test_a_late_wake_up_is_an_overrun_and_no_burst() -> None:
    cycle = cycle_of(STARTER)
    assert real_run(cycle, ScriptedClock([1 * MS], late_ns=25 * MS), 130 * MS) == [0, 30, 60, 90,
                                                                                    120]
    assert (cycle.counters.overruns, cycle.counters.missed) == (5, 10)


def test_time_in_the_program_passes_over_missed_releases_too() -> None:
    cycle = cycle_of(STARTER)
    cycle.exchange.port("client").write("IX", 0, b"\1")
    real_run(cycle, ScriptedClock([1 * MS, 95 * MS, 1 * MS]), 200 * MS)
    tags = dict(zip((t.name for t in cycle.tags), cycle.values(), strict=True))
    assert tags["MAIN.delay.ET"] == 190 * MS
    assert tags["task.overruns"] == 1 and tags["task.missed"] == 9


def test_a_run_in_real_time_ends_when_told() -> None:
    cycle = cycle_of(STARTER)

    async def scenario() -> None:
        stop = asyncio.Event()
        laps = iter(range(3))
        clock = ScriptedClock([1 * MS])
        cycle.observers.append(clock)
        await cycle.run(clock, stop, None,
                        lambda: stop.set() if next(laps, None) == 2 else None)
    asyncio.run(scenario())
    assert cycle.counters.laps == 3
    assert cycle.now_ns == 21 * MS


def test_waiting_for_a_release_can_be_cancelled() -> None:
    class Forever(ScriptedClock):
        async def sleep_until_ns(self, t_ns: int) -> None:
            await asyncio.get_running_loop().create_future()

    cycle = cycle_of(STARTER)

    async def scenario() -> None:
        running = asyncio.ensure_future(cycle.run(Forever([0]), asyncio.Event()))
        await asyncio.sleep(0)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    asyncio.run(scenario())
    assert cycle.counters.laps == 0


def test_the_same_laps_in_real_and_in_virtual_time_give_the_same_trace() -> None:
    real, virtual = batch_system("load=1", "cycle=500ms"), batch_system("load=1", "cycle=500ms")
    in_real, in_virtual = traced(real), traced(virtual)
    clock = ScriptedClock([1 * MS])
    real.cycle.observers.append(clock)
    asyncio.run(real.cycle.run(clock, asyncio.Event(), 400 * S))
    virtual.cycle.run_virtual(400 * S)
    assert without_statistics(in_real) == without_statistics(in_virtual)


def without_statistics(trace: Trace) -> list[tuple[int, list[Change]]]:
    """Return instants and changes, but for the statistics of tasks, which real time measures."""
    measured = {i for i, tag in enumerate(trace.tags) if tag.name.startswith("task.")}
    kept = [(f.t_ns, [c for c in f.changes if c[0] not in measured]) for f in trace.frames]
    return [row for row in kept if row[1]]


# the plant in the process


def client_writes(system: System, area: str, offset: int, data: bytes) -> None:
    system.exchange.port("hmi").write(area, offset, data)
    system.cycle.lap()


def test_a_client_that_drives_the_plant_s_inputs_takes_over() -> None:
    system = batch_system("load=2")
    system.cycle.run_virtual(10 * S)
    client_writes(system, "IW", 0, (777).to_bytes(2, "big"))
    plant = system.plant
    assert plant is not None and plant.stepped_aside
    system.cycle.run_virtual(1000 * S)
    assert system.exchange.published("IW", 0, 2) == (777).to_bytes(2, "big")
    assert plant.next_event_ns() is None


@pytest.mark.parametrize(("area", "offset", "data"), [
    ("IX", 0, b"\1"), ("IW", 40, b"\0\1"), ("QX", 0, b"\2"), ("MW", 0, b"\0\1")])
def test_a_client_that_writes_elsewhere_leaves_the_plant_alone(area: str, offset: int,
                                                               data: bytes) -> None:
    system = batch_system("load=2")
    system.cycle.run_virtual(10 * S)
    client_writes(system, area, offset, data)
    assert system.plant is not None and not system.plant.stepped_aside


def test_a_client_that_writes_what_the_plant_says_changes_nothing() -> None:
    system = batch_system("load=2")
    system.cycle.run_virtual(10 * S)
    client_writes(system, "IW", 0, system.exchange.published("IW", 0, 14))
    assert system.plant is not None and not system.plant.stepped_aside


def test_plant_time_is_scaled_exactly() -> None:
    system = batch_system("load=2", "time_scale=1/3", "cycle=10ms")
    system.cycle.run_virtual(1 * S)
    assert system.plant is not None
    assert system.plant.coupling.plant.t_ns == 333_333_333


@pytest.mark.parametrize("scale", ["1/3", "7", "100", "0.1"])
def test_the_next_event_is_the_first_instant_at_which_the_plant_has_reached_it(scale: str) -> None:
    system = batch_system("load=2", f"time_scale={scale}")
    system.cycle.run_virtual(1 * S)
    assert system.plant is not None
    coupling = system.plant.coupling
    event, plant_event = coupling.next_event_ns(), coupling.plant.next_event_ns()
    assert event is not None and plant_event is not None
    assert coupling.plant_time_ns(event) >= plant_event > coupling.plant_time_ns(event - 1)


# wiring


def test_tags_of_plant_monitors_and_task_stand_beside_those_of_the_program() -> None:
    system = batch_system()
    tags = system.cycle.tags
    assert tags["plant.B1.level"].unit == "l"
    assert tags["plant.overflow"].type == "BOOL"
    assert tags["monitor.no_overflow.verdict"].type == "STRING"
    assert tags["task.overruns"].type == "ULINT"
    assert tags["BATCH_PLANT.V1"].address == "%QX0.1"


def test_the_report_has_the_promised_keys() -> None:
    system = batch_system("load=2", "cycle=100ms")
    system.cycle.run_virtual(700 * S)
    report = system.report()
    assert report["t_s"] == 700.0 and report["scans"] == 7000 and report["overruns"] == 0
    assert report["state"] == "RUN" and report["plant"]["batches"] == 1
    assert set(report["tags"]) == {tag.name for tag in system.cycle.tags}
    assert {"name", "verdict", "triggers", "decided_at_s"} <= set(report["properties"][0])


def test_without_the_plant_properties_of_its_facts_are_not_judged_and_that_is_told() -> None:
    system = batch_system(with_plant=False)
    assert set(system.not_judged) >= {"no_overflow", "no_forbidden_mixture"}
    assert system.report()["not_judged"] == system.not_judged
    assert "plant" not in system.report()
    assert not {p.name for p in system.properties} & set(system.not_judged)


WRONG_SYSTEMS = {
    "an unknown engine": ("engine: steam", "config.yaml:2: engine: there is no engine 'steam'"),
    "a task of no program": (
        "tasks:\n  t: {interval: 1s, programs: [MAIN, NONE]}",
        "config.yaml:2: tasks: task t: there is no program 'NONE'; there is MAIN"),
    "a program in no task": (
        "tasks:\n  t: {interval: 1s, programs: []}",
        "config.yaml:2: tasks: found program MAIN in no tasks, expected it in one"),
    "a program in two tasks": (
        "tasks:\n  t: {interval: 1s, programs: MAIN}\n  u: {interval: 1s, programs: main}",
        "config.yaml:2: tasks: found program MAIN in 2 tasks, expected it in one"),
    "a safe value of nothing": (
        "safe_outputs:\n  pmup: true",
        "config.yaml:3: safe_outputs.pmup: there is no tag 'pmup'; did you mean 'pump'"),
    "a safe value of the wrong type": (
        "safe_outputs:\n  pump: 7", "config.yaml:3: safe_outputs.pump: 7 is not a value of type"),
    "a safe value of no output": (
        "safe_outputs:\n  count: 7",
        "config.yaml:3: safe_outputs.count: found a variable at no address, expected an output"),
    "an unknown plant": (
        "plant:\n  model: batch_plnat", "config.yaml:3: plant.model: .*did you mean batch_plant"),
    "a plant of no module": (
        "plant:\n  model: nowhere:Plant", "config.yaml:3: plant.model: .*cannot import nowhere"),
    "a plant that is none": (
        "plant:\n  model: fractions:Fraction", "config.yaml:3: plant.model: "),
    "an unknown parameter": (
        "plant:\n  model: batch_plant\n  parameters: {laod: 3}",
        ("config.yaml:4: plant.parameters.laod: found 3, expected a known parameter: did you mean "
        "load")),
    "a wrong parameter": (
        "plant:\n  model: batch_plant\n  parameters:\n    load: 99",
        "config.yaml:5: plant.parameters.load: found 99, expected 0 to 8 in steps of 0.5"),
    "an unknown port": (
        "plant:\n  model: batch_plant\n  inputs:\n    B1.levle: '%IW0'",
        ("config.yaml:5: plant.inputs.B1.levle: the plant has no such port here; did you mean "
        "'B1.level'")),
    "an actuator among the sensors": (
        "plant:\n  model: batch_plant\n  inputs:\n    V1: '%IX0.0'",
        "config.yaml:5: plant.inputs.V1: the plant has no such port here"),
    "an address twice": (
        "plant:\n  model: batch_plant\n  inputs:\n    B1.level: '%IW0'\n    B2.level: '%iw0'",
        "config.yaml:6: plant.inputs.B2.level: B1.level has %IW0 already"),
    "a range outside its area": (
        "modbus:\n  ranges:\n  - {type: coil, first: 0, count: 8, area: QX, element: 8190}",
        "config.yaml:4: modbus.ranges.0: coil 0-7 \\(QX\\): it leaves area QX"),
    "ranges over each other": (
        ("modbus:\n  ranges:\n  - {type: coil, first: 0, count: 8, area: QX}\n"
        "  - {type: coil, first: 7, count: 8, area: MX}"),
        "config.yaml:3: modbus.ranges: coil 7-14 \\(MX\\) overlaps"),
}


@pytest.mark.parametrize(("text", "said"), WRONG_SYSTEMS.values(), ids=WRONG_SYSTEMS)
def test_parts_that_do_not_fit_are_told_with_the_place(tmp_path: Path, text: str,
                                                       said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        system_of(tmp_path, text)
    assert len(caught.value.problems) == 1
    caught.match(f"^{tmp_path}/{said}")


def test_a_wrong_override_is_told_as_such(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^--set load=99: plant.parameters.load: found 99"):
        batch_system("load=99")


def test_tasks_of_a_configuration_run_at_their_intervals(tmp_path: Path) -> None:
    system = system_of(tmp_path, "tasks:\n  a: {interval: 5ms, programs: MAIN, phase: 2ms}\n")
    assert system.cycle.t_ns == 2 * MS
    system.cycle.run_virtual(20 * MS)
    assert system.cycle.scan_number == 4


def test_a_name_need_not_be_ascii(tmp_path: Path) -> None:
    assert system_of(tmp_path, f"name: Köln {'x' * 500}\n").server() is not None


def test_in_stop_plant_and_clock_go_on() -> None:
    system = batch_system("load=2", "cycle=100ms")
    system.cycle.run_virtual(100 * S)
    system.resource.stop()
    assert system.resource.state is State.STOP
    system.cycle.run_virtual(200 * S)
    report = system.report()
    assert (report["t_s"], report["plant"]["t_s"], report["scans"]) == (200.0, 200.0, 2000)
    assert report["tags"]["BATCH_PLANT.V8"] is False
