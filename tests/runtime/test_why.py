"""Why a value is what it is: instructions, steps, timers and inputs, checked by hand."""

import re

import pytest
from hypothesis import given, settings
from journeys import do, journeys, programs
from systems import batch_system

import plcemu
from plcemu.base.errors import PlcemuError, UnknownNameError
from plcemu.runtime.history import History, HistoryError
from plcemu.runtime.why import Why

S = 1_000_000_000

ST = """PROGRAM MAIN
VAR start AT %IX0.0 : BOOL; stop AT %IX0.1 : BOOL; run : BOOL; lamp AT %QX0.0 : BOOL;
    n : INT; limit : INT := 3; delay : TON; END_VAR
  run := (start OR run) AND NOT stop;
  delay(IN := run, PT := T#50ms);
  IF delay.Q THEN
    n := limit + 4;
  END_IF;
  lamp := delay.Q;
END_PROGRAM
"""
IL = """PROGRAM MAIN
VAR a AT %IX0.0 : BOOL; b AT %IX0.1 : BOOL; q AT %QX0.0 : BOOL; kept : BOOL; END_VAR
  LD a
  ANDN b
  ST q
  LD a
  S kept
END_PROGRAM
"""
SFC = """PROGRAM MAIN
VAR go AT %IX0.0 : BOOL; out AT %QX0.0 : BOOL; END_VAR
INITIAL_STEP REST: END_STEP
STEP WORK: act(N); END_STEP
TRANSITION FROM REST TO WORK := go; END_TRANSITION
TRANSITION FROM WORK TO REST := WORK.T >= T#100ms; END_TRANSITION
ACTION act: out := TRUE; END_ACTION
END_PROGRAM
"""
LOOP = """FUNCTION twice : INT
VAR_INPUT x : INT; END_VAR
  twice := x * 2;
END_FUNCTION
PROGRAM MAIN
VAR a AT %IW0 : INT; other AT %IW1 : INT; sum : INT; i : INT; unread : INT; END_VAR
  unread := other;
  sum := 0;
  FOR i := 1 TO 3 DO
    sum := sum + twice(a);
  END_FOR;
END_PROGRAM
"""


def recorded(program, **options):
    return plcemu.Plc(program, record=True, engine="interpreter", **options)


def tags(cause):
    return [each.tag for each in cause.causes]


def test_a_stored_result_comes_from_what_was_read_in_its_expression():
    plc = recorded(IL)
    plc["a"] = True
    plc.scan()
    cause = plc.why("q")
    assert (cause.tag, cause.value, cause.kind, cause.line) == ("MAIN.q", True, "assignment", 5)
    assert [(c.tag, c.value, c.kind) for c in cause.causes] == [
        ("MAIN.a", True, "input"), ("MAIN.b", False, "initial")]
    assert cause.causes[0].note == "written by python at %IX0.0"


def test_a_value_that_was_set_once_is_explained_by_the_scan_that_set_it():
    plc = recorded(IL)
    plc.scan(3)
    plc["a"] = True
    plc.scan()
    plc["a"] = False
    plc.scan(300)
    held = plc.why("kept")
    assert (held.value, held.line, held.since_ns) == (True, 7, 30_000_000)
    assert [(c.tag, c.value) for c in held.causes] == [("MAIN.a", False), ("MAIN.kept", True)]
    begin = held.causes[1]
    assert begin.scan == 3
    assert [(c.tag, c.value, c.scan) for c in begin.causes] == [
        ("MAIN.a", True, 3), ("MAIN.kept", False, 0)]


def test_the_condition_of_a_statement_is_among_its_causes():
    plc = recorded(ST)
    plc["start"] = True
    plc.scan()
    plc["start"] = False
    plc.scan(10)
    cause = plc.why("n")
    assert (cause.value, cause.text, tags(cause)) == \
        (7, "n := limit + 4;", ["MAIN.delay.Q", "MAIN.limit"])
    assert cause.causes[1].kind == "initial"


def test_a_timer_tells_since_when_its_input_holds_and_how_long_it_ran():
    plc = recorded(ST)
    plc.scan(2)
    plc["start"] = True
    plc.scan()
    plc["start"] = False
    plc.scan(20)
    timer = plc.why("lamp").causes[0]
    assert (timer.tag, timer.kind, timer.since_ns) == ("MAIN.delay.Q", "block", 70_000_000)
    assert timer.note == "timer: ET 50ms of PT 50ms"
    assert (timer.line, timer.text) == (5, "delay(IN := run, PT := T#50ms);")
    assert [(c.tag, c.value, c.since_ns) for c in timer.causes] == [
        ("MAIN.delay.IN", True, 20_000_000), ("MAIN.delay.PT", 50_000_000, 0)]
    assert timer.causes[1].kind == "constant"


def test_a_value_that_holds_itself_leads_back_to_what_set_it():
    plc = recorded(ST)
    plc["start"] = True
    plc.scan()
    plc["start"] = False
    plc.scan(500)
    now = plc.why("run")
    assert [(c.tag, c.value) for c in now.causes] == [
        ("MAIN.start", False), ("MAIN.run", True), ("MAIN.stop", False)]
    begin = now.causes[1]
    assert (begin.scan, begin.causes[0].tag, begin.causes[0].value) == (0, "MAIN.start", True)


def test_a_step_comes_from_the_step_before_and_the_condition():
    plc = recorded(SFC)
    plc.scan(3)
    plc["go"] = True
    plc.scan(4)
    cause = plc.why("out")
    assert (cause.line, cause.text) == (7, "ACTION act: out := TRUE; END_ACTION")
    step = cause.causes[0]
    assert (step.tag, step.kind, step.since_ns) == ("MAIN.WORK.X", "step", 30_000_000)
    assert [(c.tag, c.kind) for c in step.causes] == [
        ("MAIN.REST.X", "initial"), ("MAIN.go", "input")]


def test_a_time_that_ended_a_step_is_explained_by_the_step():
    plc = recorded(SFC)
    plc["go"] = True
    plc.scan(2)
    plc["go"] = False
    plc.scan(20)
    cause = plc.why("MAIN.WORK.X")
    assert (cause.value, tags(cause)) == (False, ["MAIN.WORK.X", "MAIN.WORK.T"])
    assert cause.causes[1].kind == "clock"
    assert cause.causes[1].causes[0].tag == "MAIN.WORK.X"


def test_calls_and_loops_are_looked_through_and_what_was_not_used_is_not_named():
    plc = recorded(LOOP)
    plc["a"], plc["other"] = 5, 9
    plc.scan()
    cause = plc.why("sum")
    assert cause.value == 30
    assert "MAIN.other" not in {c.tag for c in cause.walk()}
    assert "MAIN.a" in {c.tag for c in cause.leaves}


def test_an_instant_of_the_past_is_explained_as_it_was():
    plc = recorded(IL)
    plc["a"] = True
    plc.scan(3)
    plc["a"] = False
    plc.scan(3)
    assert (plc.why("q").value, plc.why("q", at="25ms").value, plc.why("q", at=0).value) == \
        (False, True, True)
    assert plc.why("q", at="29ms").t_ns == 20_000_000


def test_explaining_changes_nothing_in_the_plc_that_is_asked():
    plc, other = recorded(SFC), recorded(SFC)
    for each in (plc, other):
        each["go"] = True
        each.scan(4)
        each["go"] = False
    plc.why("out")
    for each in (plc, other):
        each.scan(12)
    assert plc.snapshot() == other.snapshot()
    assert plc.trace.frames == other.trace.frames


def test_forced_and_safe_values_say_so():
    plc = recorded(IL)
    plc.scan()
    plc.force("q", True)
    plc.scan()
    assert plc.why("q").kind == "forced"
    plc.unforce("q")
    plc["a"] = True
    plc.scan()
    plc.stop()
    plc.scan()
    stopped = plc.why("q")
    assert (stopped.kind, stopped.value) == ("safe", False)


def test_the_depth_is_a_limit_that_is_told():
    plc = recorded(ST)
    plc["start"] = True
    plc.scan(10)
    assert plc.why("n", depth=1).kind == "depth"
    assert "deeper than shown" in str(plc.why("n", depth=1))
    assert {c.kind for c in plc.why("n", depth=3).leaves} == {"depth", "initial"}
    with pytest.raises(PlcemuError, match="expected 1 or more"):
        plc.why("n", depth=0)


def test_what_cannot_be_explained_is_refused_with_what_to_do():
    plc = recorded(IL)
    with pytest.raises(HistoryError, match="no scan"):
        plc.why("q")
    plc.scan()
    with pytest.raises(UnknownNameError):
        plc.why("qq")
    with pytest.raises(HistoryError, match="lies ahead"):
        plc.why("q", at="1h")
    with pytest.raises(HistoryError, match="record=True"):
        plcemu.Plc(IL).why("q")


def test_a_value_older_than_the_record_says_so():
    plc = plcemu.Plc(IL, engine="interpreter", history=30_000)
    plc["a"] = True
    plc.scan()
    plc["a"] = False
    for n in range(2000):
        plc["b"] = bool(n % 2)
        plc.scan()
    assert plc.history.first_scan > 1
    leaves = plc.why("kept").leaves
    assert {leaf.kind for leaf in leaves if leaf.tag == "MAIN.kept"} == {"record"}
    assert "older than the record" in str(plc.why("kept"))


def test_the_batch_plants_valve_is_explained_from_its_levels():
    system = batch_system()
    history = History(system.cycle)
    system.cycle.run_virtual(101 * S)
    why = Why(history, system.cycle)
    cause = why.explain("V8", why.scan_at(100 * S))
    assert (cause.value, cause.text, tags(cause)) == \
        (True, "ST V8", ["BATCH_PLANT.wait1.X", "BATCH_PLANT.Theta1"])
    assert "plant" in {leaf.tag: leaf for leaf in cause.leaves}["BATCH_PLANT.B1_level"].note


ENDS = {"input", "constant", "initial", "clock", "forced", "safe", "restart", "seen", "depth"}


@settings(max_examples=25, deadline=None)
@given(programs, journeys)
def test_branches_end_where_they_may_and_lines_name_what_they_write(program, journey):
    plc = recorded(program)
    do(plc, journey)
    plc.scan(2)
    for tag in plc.cycle.resource.memory.tags:
        for cause in plc.why(tag.name, depth=4).walk():
            assert cause.causes or cause.kind in ENDS
            parts = [p.casefold() for p in cause.tag.split(".")]
            assert not cause.text or any(re.search(rf"\b{re.escape(p.partition('[')[0])}\b",
                                                   cause.text.casefold()) for p in parts), cause
