"""What follows when a property is violated: in which scan, and what a person must do then."""

import pytest
from systems import system_of

from plcemu.base.errors import ConfigError
from plcemu.base.trace import Trace
from plcemu.base.tracefile import load
from plcemu.runtime.alarms import AlarmError
from plcemu.runtime.history import History
from plcemu.runtime.reactions import InterlockError

MS, S = 1_000_000, 1_000_000_000

PROGRAM = """PROGRAM MAIN
VAR hot AT %IX0.0 : BOOL; heater AT %QX0.0 : BOOL; limit : INT := 5; n : INT; seen : INT; END_VAR
  heater := TRUE;
  n := n + 1;
  seen := limit;
END_PROGRAM
"""
STILL = PROGRAM.replace("  n := n + 1;\n", "")
PROPERTIES = """cool "hot must not last": G (hot -> F[0s,50ms] !hot)
cold: G !hot
"""


def system(folder, reactions, program=PROGRAM, more=""):
    (folder / "rules.prop").write_text(PROPERTIES)
    return system_of(folder, f"properties: rules.prop\n{more}reactions:\n{reactions}", program)


def write(made, name, value):
    made.reactions._tags(made.cycle).write(name, value)


def test_an_interlock_stops_in_the_scan_that_sees_the_violation(tmp_path):
    made = system(tmp_path, "  cold: {stop: true}\n")
    made.cycle.lap()
    assert made.exchange.published("QX", 0, 1) == b"\x01"
    write(made, "hot", True)
    made.cycle.lap()
    assert (made.resource.state.value, made.exchange.published("QX", 0, 1)) == ("STOP", b"\x00")
    assert made.resource.memory.read(made.cycle.tags.find("n")) == 2


def test_a_deadline_that_passes_between_scans_stops_at_the_next_one(tmp_path):
    made = system(tmp_path, "  cool: {stop: true}\n", more="cycle: 20ms\n")
    write(made, "hot", True)
    made.cycle.run_virtual(50 * MS)
    assert made.resource.state.value == "RUN"
    made.cycle.lap()
    assert (made.resource.state.value, made.cycle.suite.results()[0].decided_at_ns) == \
        ("STOP", 50 * MS)
    assert made.reactions.alarms["cool"].raised_ns == 60 * MS


def test_a_stopped_plc_runs_again_only_after_the_alarm_is_acknowledged(tmp_path):
    made = system(tmp_path, "  cold: {stop: true}\n")
    write(made, "hot", True)
    made.cycle.lap()
    with pytest.raises(InterlockError, match="because cold was violated; acknowledge"):
        made.cycle.resume()
    with pytest.raises(InterlockError):
        made.cycle.restart(cold=True)
    write(made, "hot", False)
    made.cycle.lap()
    made.reactions.acknowledge("cold")
    made.cycle.resume()
    made.cycle.run_virtual(100 * MS)
    assert made.resource.state.value == "RUN"
    assert made.reactions.alarms["cold"].state == "cleared"


def test_what_is_still_violated_when_it_is_acknowledged_is_raised_again(tmp_path):
    made = system(tmp_path, "  cold: {stop: true}\n")
    write(made, "hot", True)
    made.cycle.lap()
    made.reactions.acknowledge("cold")
    made.cycle.resume()
    made.cycle.lap()
    alarm = made.reactions.alarms["cold"]
    assert (made.resource.state.value, alarm.state, alarm.count) == ("STOP", "raised", 2)


def test_alarms_go_from_normal_to_raised_to_acknowledged_to_cleared(tmp_path):
    made = system(tmp_path, "  cold: {alarm: {severity: low, text: too hot}}\n")
    trace = Trace(made.cycle.tags)
    made.cycle.observers.append(trace)
    made.cycle.run_virtual(20 * MS)
    write(made, "hot", True)
    made.cycle.run_virtual(40 * MS)
    write(made, "hot", False)
    made.cycle.run_virtual(60 * MS)
    made.reactions.acknowledge("cold")
    made.cycle.run_virtual(100 * MS)
    assert trace.history("alarm.cold.state") == [
        (0, "normal"), (30 * MS, "raised"), (60 * MS, "acknowledged"), (70 * MS, "cleared")]
    assert [e.state.value for e in made.reactions.alarms.journal] == [
        "raised", "acknowledged", "cleared"]
    assert made.report()["alarms"] == [
        {"name": "cold", "severity": "low", "text": "too hot", "state": "cleared", "count": 1,
         "raised_s": 0.02}]


def test_an_acknowledgement_of_nothing_is_refused(tmp_path):
    made = system(tmp_path, "  cold: {alarm: high}\n")
    made.cycle.lap()
    with pytest.raises(AlarmError, match="normal, not raised"):
        made.reactions.acknowledge("cold")
    with pytest.raises(AlarmError, match="did you mean 'cold'"):
        made.reactions.acknowledge("colt")


def test_a_tag_is_set_once_for_the_scan_after_the_violation(tmp_path):
    made = system(tmp_path, "  cold: {set: {limit: 2}}\n")
    read = made.resource.memory.read
    write(made, "hot", True)
    made.cycle.lap()
    assert read(made.cycle.tags.find("seen")) == 5
    made.cycle.lap()
    assert read(made.cycle.tags.find("seen")) == 2
    write(made, "limit", 7)
    made.cycle.lap()
    made.cycle.lap()
    assert read(made.cycle.tags.find("seen")) == 7


def test_a_recording_holds_the_seconds_before_and_after(tmp_path):
    made = system(tmp_path, "  cold: {record: {before: 30ms, after: 20ms, "
                  "file: 'at-{t}.jsonl'}}\n")
    made.cycle.run_virtual(1 * S)
    write(made, "hot", True)
    made.cycle.run_virtual(2 * S)
    made.close()
    trace = load(tmp_path / "at-1s.jsonl")
    begin = 1 * S - 30 * MS
    assert (trace.frames[0].t_ns, trace.end_ns) == (begin, 1 * S + 20 * MS)
    assert trace.history("MAIN.hot") == [(begin, False), (1 * S, True)]
    assert len(trace.frames[0].changes) == len(trace.tags)


def test_a_second_recording_of_a_name_does_not_overwrite_the_first(tmp_path):
    made = system(tmp_path, "  cold: {record: {before: 0s, after: 0s, file: x.csv}, "
                  "alarm: true}\n")
    write(made, "hot", True)
    made.cycle.lap()
    made.reactions.acknowledge("cold")
    made.cycle.run_virtual(100 * MS)
    made.close()
    assert sorted(p.name for p in tmp_path.glob("*.csv")) == ["x-2.csv", "x.csv"]


@pytest.mark.parametrize(("reactions", "message"), [
    ("  colt: {stop: true}\n", "there is no property 'colt'; did you mean 'cool'"),
    ("  cold: {set: {lim: 1}}\n", "there is no tag 'lim'"),
    ("  cold: {set: {limit: 99999}}\n", "limit"),
    ("  cold: {stopp: true}\n", "there is no key 'reactions.cold.stopp'; did you mean 'stop'"),
    ("  cold: {record: {file: x.txt}}\n", "found the ending '.txt'"),
    ("  cold: {record: {file: '{a}.vcd'}}\n", "expected a file name"),
    ("  cold: {alarm: {severity: bad}}\n", "found 'bad', expected"),
])
def test_a_wrong_reaction_is_told_with_its_place(tmp_path, reactions, message):
    with pytest.raises(ConfigError, match=r"config\.yaml:\d+") as caught:
        system(tmp_path, reactions)
    assert message in str(caught.value)


def run(folder, dense):
    folder.mkdir()
    made = system(folder, "  cool: {set: {limit: 2}, alarm: true}\n", STILL)
    trace = Trace(made.cycle.tags)
    made.cycle.state_observers.append(trace)
    write(made, "hot", True)
    made.cycle.run_virtual(1 * S, dense=dense)
    return made, trace


def test_scans_are_passed_over_between_reactions_and_the_trace_is_the_same(tmp_path):
    (sparse, seen), (dense, all_seen) = run(tmp_path / "a", False), run(tmp_path / "b", True)
    assert seen.frames == all_seen.frames
    assert sparse.cycle.counters.laps < dense.cycle.counters.laps == 100
    assert seen.history("MAIN.seen")[-1] == (60 * MS, 2)


def test_time_travel_takes_reactions_and_alarms_along(tmp_path):
    made = system(tmp_path, "  cold: {stop: true, set: {limit: 2}}\n")
    history = History(made.cycle)
    trace = Trace(made.cycle.tags)
    made.cycle.observers.append(trace)
    made.cycle.run_virtual(50 * MS)
    write(made, "hot", True)
    made.cycle.run_virtual(100 * MS)
    write(made, "hot", False)
    made.cycle.lap()
    made.reactions.acknowledge("cold")
    made.cycle.resume()
    made.cycle.run_virtual(200 * MS)
    frames = list(trace.frames)
    history.rewind(3)
    assert made.reactions.alarms["cold"].state == "normal"
    history.replay()
    assert trace.frames == frames
    assert made.reactions.alarms["cold"].state == "cleared"
