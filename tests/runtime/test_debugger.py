"""The debugger stops where it was told to, and shows what is true there."""

import pytest
from hypothesis import given, settings
from journeys import do, journeys, programs, stand
from systems import batch_system

import plcemu
from plcemu.base.errors import CompileError
from plcemu.runtime.debugger import DebugError, Why
from plcemu.runtime.history import HistoryError

TEXT = """PROGRAM MAIN
VAR go AT %IX0.0 : BOOL; n : INT; last : INT; lamp AT %QX0.0 : BOOL; END_VAR
  last := n;
  n := n + 1;
  IF n = 4 THEN
    lamp := go;
  END_IF;
END_PROGRAM
"""
CHART = """PROGRAM MAIN
VAR n : INT; END_VAR
INITIAL_STEP A: count(N); END_STEP
STEP B: END_STEP
TRANSITION FROM A TO B := n > 5; END_TRANSITION
TRANSITION FROM B TO A := FALSE; END_TRANSITION
ACTION count:
  n := n + 1;
END_ACTION
END_PROGRAM
"""


@pytest.fixture(scope="module")
def program():
    return plcemu.compile(TEXT)


@pytest.fixture
def plc(program):
    return plcemu.Plc(program, record=True)


@pytest.fixture
def debugger(plc):
    return plcemu.Debugger(plc)


def test_scans_are_stepped_one_by_one_or_many(debugger):
    assert (debugger.scan().scan, debugger.read("n")) == (1, 1)
    assert (debugger.scan(9).scan, debugger.read("n")) == (10, 10)


def test_instructions_are_stepped_and_values_are_those_before_the_next_one(debugger):
    debugger.scan(2)
    debugger.step()
    seen = [(str(debugger.event).partition(" ;")[0], debugger.read("last"), debugger.read("n"))]
    for _ in range(5):
        debugger.step()
        seen.append((str(debugger.event).partition(" ;")[0], debugger.read("last"),
                     debugger.read("n")))
    assert [(last, n) for _, last, n in seen] == [(1, 2), (1, 2), (2, 2), (2, 2), (2, 2), (2, 2)]
    assert debugger.step().event.line == ("<text>", 5)
    assert debugger.read("n") == 3
    debugger.step_back(3)
    assert debugger.read("n") == 2


def test_lines_are_stepped_over_what_is_not_executed(debugger):
    lines = [debugger.next().event.line[1] for _ in range(3)]
    assert lines[:3] == [3, 4, 5]
    stop = debugger.scan()
    assert (stop.event, stop.scan) == (None, 1)


def test_a_breakpoint_at_a_line_is_met_once_a_time(debugger):
    assert debugger.break_at("6") == "<text>:6"
    stop = debugger.run()
    assert (stop.why, stop.text, stop.scan) == (Why.BREAKPOINT, "<text>:6", 3)
    assert (stop.event.line[1], debugger.read("n")) == (6, 4)
    assert debugger.run(limit=100).why is Why.LIMIT


def test_a_breakpoint_at_an_action_is_met_when_it_begins():
    debugger = plcemu.Plc(CHART).debug()
    debugger.break_at("main.count")
    assert [debugger.run().scan for _ in range(3)] == [0, 1, 2]


@pytest.mark.parametrize(("place", "told"), [
    ("7000", "the nearest is <text>:"),
    ("other.st:3", "no code comes from other.st; it comes from"),
    ("MAINN", "did you mean 'MAIN'")])
def test_a_breakpoint_where_no_code_is_is_refused(debugger, place, told):
    with pytest.raises(DebugError, match=told):
        debugger.break_at(place)


def test_a_watch_stops_behind_the_store_with_both_values(debugger):
    assert debugger.watch("last") == "MAIN.last"
    stop = debugger.run()
    assert (stop.why, stop.text, stop.scan) == (Why.WATCH, "MAIN.last: 0 -> 1", 1)
    assert debugger.read("last") == 1
    assert debugger.read("n") == 1
    debugger.clear("MAIN.last")
    assert debugger.run(limit=50).why is Why.LIMIT


def test_a_watch_sees_what_a_client_changes(plc, debugger):
    debugger.watch("go")
    plc["go"] = True
    assert debugger.run().text == "MAIN.go: False -> True"


def test_a_step_of_a_chart_is_waited_for():
    debugger = plcemu.Plc(CHART).debug()
    assert debugger.chart().text == "MAIN.A entered"
    stop = debugger.chart()
    assert (stop.text, debugger.read("n")) == ("MAIN.A left, MAIN.B entered", 6)
    assert debugger.chart(limit=20).why is Why.LIMIT


def test_a_program_without_charts_has_no_step_to_wait_for(debugger):
    with pytest.raises(DebugError, match="no steps"):
        debugger.chart()


def test_until_takes_an_instant_or_a_condition(debugger):
    assert debugger.until("50ms").t_ns == 50_000_000
    assert (debugger.until("n >= 12 & !go").scan, debugger.read("n")) == (12, 12)
    with pytest.raises(CompileError):
        debugger.until("nothing > 3")
    with pytest.raises(DebugError, match="more than one instant"):
        debugger.until("F[0s,1s] n > 3")


def test_a_fault_stops_at_its_instruction():
    plc = plcemu.Plc("PROGRAM MAIN VAR n : INT := 3; m : INT; END_VAR\nn := n - 1;\nm := 10 / n;\n"
                     "END_PROGRAM")
    debugger = plc.debug()
    stop = debugger.run()
    assert (stop.why, stop.text, stop.event.line[1]) == (Why.FAULT, "division by zero", 3)
    assert (plc.state, debugger.read("n")) == ("FAULT", 0)
    debugger.back()
    assert (plc.state, debugger.read("n")) == ("RUN", 1)


def test_back_and_on_again_does_the_same_with_the_same_inputs(plc, debugger):
    debugger.scan(3)
    plc["go"] = True
    debugger.scan(2)
    there = stand(plc)
    debugger.back(4)
    assert debugger.read("n") == 1
    debugger.scan(4)
    assert stand(plc) == there
    assert plc["lamp"] is True


def test_back_from_inside_a_scan_goes_to_before_it(debugger):
    debugger.scan(5)
    debugger.step(4)
    assert (debugger.back().scan, debugger.read("n")) == (5, 5)
    with pytest.raises(HistoryError, match="where the record begins"):
        debugger.back(6)


def test_the_trace_tells_what_wrote_a_tag(debugger):
    debugger.step()
    (event,) = debugger.trace.writers("main.N")
    assert (event.line, event.writes[0].value) == (("<text>", 4), 1)


@given(programs, journeys)
@settings(max_examples=30, deadline=None)
def test_a_debugged_plc_does_what_an_undisturbed_one_does(program, way):
    plc, twin = (plcemu.Plc(program, engine="interpreter", record=True) for _ in range(2))
    debugger = plc.debug()
    debugger.break_at("MAIN")
    do(plc, way)
    do(twin, way)
    debugger.clear()
    debugger.step(5)
    debugger.scan()
    twin.scan(plc.scan_number - twin.scan_number)
    assert (stand(plc), plc.trace.frames) == (stand(twin), twin.trace.frames)


def test_plant_and_monitors_are_debugged_with_the_plc():
    system, twin = batch_system("load=3"), batch_system("load=3")
    with plcemu.Debugger(system) as debugger:
        debugger.run(until_ns=20_000_000_000)
        debugger.back(300)
        debugger.run(until_ns=20_000_000_000)
    twin.cycle.run_virtual(20_000_000_000)
    assert system.report()["tags"] == twin.report()["tags"]
    assert system.resource.probe is None


def test_what_is_no_plc_cannot_be_debugged():
    with pytest.raises(TypeError, match="a Plc or a System"):
        plcemu.Debugger(3)
