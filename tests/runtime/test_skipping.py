"""Scans that cannot matter: runs that pass over them tell the same as dense runs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from systems import MS, S

from plcemu.base.trace import Frame, Trace
from plcemu.engine.resource import Resource
from plcemu.ir.program import Program, Task
from plcemu.lang.compile import compile_program
from plcemu.monitor import parse_properties
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.plc import Plc, make_exchange

ENGINES = ("interpreter", "wasm")
OFTEN = settings(max_examples=20, deadline=None)

PIECES = (
    "t(IN := a, PT := T#340ms); x := t.Q;",
    "u(IN := b, PT := T#470ms); y := u.Q;",
    "v(IN := a AND NOT b, PT := T#550ms); x := v.Q;",
    "IF a THEN t(IN := TRUE, PT := T#90ms); END_IF; y := t.Q;",
    "t(IN := TRUE, PT := T#300ms); t(IN := a, PT := T#700ms); x := t.Q;",
    "IF b THEN pt := T#200ms; ELSE pt := T#900ms; END_IF; t(IN := a, PT := pt);",
    "t(IN := NOT t.Q, PT := T#260ms); IF t.Q THEN n := n + 1; END_IF;",
    "w(IN := a, PT := T#310ms); IF w.Q AND NOT z THEN n := n + 1; END_IF; z := w.Q;",
    "c(CU := t.Q, R := b, PV := 3); x := c.Q;",
    "x := x XOR u.Q; w(IN := b, PT := T#110ms);",
)
READS = ("IF t.ET > T#200ms THEN n := n + 1; END_IF;", "last := u.ET;")
DECLARED = ("VAR_GLOBAL a, b : BOOL; END_VAR PROGRAM {} VAR x, y, z : BOOL; n : INT; pt, last : "
            "TIME; t : TON; u : TOF; v : TP; w : TON; c : CTU; END_VAR {} END_PROGRAM")
bodies = st.lists(st.sampled_from(PIECES), min_size=1, max_size=4).map(" ".join)
writes = st.lists(st.tuples(st.integers(0, 60), st.sampled_from("ab"), st.booleans()),
                  min_size=1, max_size=6)


@cache
def program_of(*texts: str) -> Program:
    """Return the program of bodies: two global inputs, and a PROGRAM for each body."""
    head, _, rest = DECLARED.partition(" PROGRAM")
    programs = [("PROGRAM" + rest).format(f"p{n}", body) for n, body in enumerate(texts)]
    return compile_program("\n".join([head, *programs]))


class Run:
    """A run of a program with writes at given times, recorded without unread elapsed times."""

    def __init__(self, program: Program, tasks: Sequence[Task], engine: str, *, dense: bool,
                 properties: str = "") -> None:
        self.dense = dense
        self.resource = Resource(program, 10 * MS, engine, tasks or None)
        self.cycle = Cycle(self.resource, make_exchange(self.resource), None,
                           parse_properties(properties))
        self.trace = Trace(self.cycle.tags)
        self.cycle.state_observers.append(self.trace)

    def write(self, name: str, value: bool) -> None:
        offset, row = self.resource.memory.place(self.resource.memory.tags.find(name))
        self.cycle.exchange.port("test").write("MEMORY", offset, row.pack(value))

    def play(self, script: Sequence[tuple[int, str, bool]]) -> Run:
        for pause, name, value in script:
            self.cycle.run_virtual(self.cycle.t_ns + pause * 10 * MS, dense=self.dense)
            self.write(name, value)
        self.cycle.run_virtual(self.cycle.t_ns + 2 * S, dense=self.dense)
        return self

    def told(self) -> list[object]:
        """Return all that may be known of the run."""
        return [self.trace.frames, self.resource.snapshot(), self.cycle.values(),
                self.cycle.scan_number, self.cycle.t_ns,
                [result.as_json() for result in self.cycle.suite.results()]]


def both(program: Program, tasks: Sequence[Task], script: Sequence[tuple[int, str, bool]],
         engine: str, properties: str = "") -> tuple[Run, Run]:
    dense, sparse = (Run(program, tasks, engine, dense=d, properties=properties).play(script)
                     for d in (True, False))
    return dense, sparse


@pytest.mark.parametrize("engine", ENGINES)
@given(bodies, writes)
@settings(max_examples=12, deadline=None)
def test_of_one_task_a_run_that_skips_tells_what_the_dense_run_tells(
        engine: str, body: str, script: list[tuple[int, str, bool]]) -> None:
    dense, sparse = both(program_of(body), [], script, engine)
    assert sparse.told() == dense.told()


@given(bodies, bodies, writes, st.sampled_from([10, 30, 70]), st.sampled_from([10, 50, 230]),
       st.integers(0, 9))
@OFTEN
def test_of_several_tasks_too(first: str, second: str, script: list[tuple[int, str, bool]],
                              fast_ms: int, slow_ms: int, phase_ms: int) -> None:
    tasks = [Task("fast", fast_ms * MS, 0, 0, ("p0",)),
             Task("slow", slow_ms * MS, 1, phase_ms * MS, ("p1",))]
    dense, sparse = both(program_of(first, second), tasks, script, "interpreter")
    assert sparse.told() == dense.told()


@given(bodies, bodies, writes, st.sampled_from(["", "INTERVAL := T#70ms, "]))
@OFTEN
def test_of_tasks_with_events_too(first: str, second: str, script: list[tuple[int, str, bool]],
                                  interval: str) -> None:
    head, _, rest = DECLARED.partition(" PROGRAM")
    texts = [("PROGRAM" + rest).format(f"p{n}", body) for n, body in enumerate((first, second))]
    configuration = (f"CONFIGURATION c RESOURCE r ON plc TASK e(SINGLE := a, {interval}"
                     "PRIORITY := 1); TASK s(INTERVAL := T#20ms, PRIORITY := 2); PROGRAM one WITH "
                     "e : p0; PROGRAM two WITH s : p1; END_RESOURCE END_CONFIGURATION")
    program = compile_program("\n".join([head, *texts, configuration]))
    dense, sparse = both(program, [], script, "interpreter")
    assert sparse.told() == dense.told()


@given(bodies, st.sampled_from(READS), writes)
@OFTEN
def test_a_program_that_reads_elapsed_times_runs_densely_and_correctly(
        body: str, reads: str, script: list[tuple[int, str, bool]]) -> None:
    dense, sparse = both(program_of(f"{body} {reads}"), [], script, "interpreter")
    assert sparse.told() == dense.told()


@given(bodies, writes)
@OFTEN
def test_a_full_trace_holds_every_elapsed_time(body: str,
                                               script: list[tuple[int, str, bool]]) -> None:
    traces = []
    for dense in (True, False):
        plc = Plc(program_of(body), engine="interpreter", record=True)
        for pause, name, value in script:
            plc._cycle.run_virtual(plc.t_ns + pause * 10 * MS, dense=dense)
            plc[name] = value
        plc._cycle.run_virtual(plc.t_ns + 2 * S, dense=dense)
        traces.append((plc.trace.frames, plc.snapshot()))
    assert traces[0] == traces[1]


@given(bodies, writes)
@OFTEN
def test_verdicts_about_elapsed_times_are_those_of_the_dense_run(
        body: str, script: list[tuple[int, str, bool]]) -> None:
    body += " t(IN := a, PT := T#2s);"
    properties = "soon: G (p0.t.ET < T#1s)\nlate: F[0s,1s] (p0.t.ET > T#350ms)"
    dense, sparse = both(program_of(body), [], script, "interpreter", properties)
    assert sparse.told() == dense.told()


def laps(body: str, until_ns: int = 100 * S, properties: str = "") -> int:
    run = Run(program_of(body), [], "wasm", dense=False, properties=properties)
    run.write("a", True)
    run.cycle.run_virtual(until_ns)
    return run.cycle.counters.laps


def test_until_a_timer_expires_nothing_is_executed() -> None:
    assert laps("t(IN := a, PT := T#90s); x := t.Q;") < 10


def test_a_blinking_light_is_executed_when_it_blinks() -> None:
    assert laps("t(IN := NOT t.Q, PT := T#1s); x := x XOR t.Q;") < 100 * 5


@pytest.mark.parametrize("body", [
    "t(IN := a, PT := T#90s); IF t.ET > T#1h THEN n := 0; END_IF;", "n := n + 1;",
    "t(IN := a, PT := T#80s); t(IN := a, PT := T#90s);"])
def test_what_reads_or_counts_time_in_every_scan_is_executed_in_every_scan(body: str) -> None:
    assert laps(body, 10 * S) == 1000


def test_a_property_of_an_elapsed_time_has_every_scan_executed() -> None:
    body = "t(IN := a, PT := T#90s);"
    assert laps(body, 10 * S, "p: G (p0.t.ET < T#1h)") == 1000
    assert laps(body, 10 * S) < 10


def test_who_is_shown_every_frame_has_every_elapsed_time() -> None:
    run = Run(program_of("t(IN := a, PT := T#5s);"), [], "wasm", dense=False)
    seen: list[Frame] = []

    class All:
        def observe(self, frame: Frame) -> None:
            seen.append(frame)

    run.cycle.observers.append(All())
    run.write("a", True)
    run.cycle.run_virtual(10 * S)
    elapsed = run.cycle.tags.find("p0.t.ET")
    assert [v for f in seen for i, v in f.changes if i == elapsed] == [
        n * 10 * MS for n in range(501)]
