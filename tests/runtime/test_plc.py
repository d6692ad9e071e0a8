"""The PLC as a Python object, as its users are promised it."""

from __future__ import annotations

from pathlib import Path

import pytest
from systems import MS, STARTER, S

import plcemu
from plcemu.base.errors import PlcemuError, UnknownNameError
from plcemu.base.time import DurationError
from plcemu.ir.program import Task

DIVIDER = """PROGRAM MAIN
VAR go AT %IX0.0 : BOOL; out AT %QX0.0 : BOOL := TRUE; a, b : INT; n : INT := 100; END_VAR
  LD  a
  ADD 1
  ST  a
  LDN go
  JMPC done
  LD  n
  DIV b
  ST  n
done:
END_PROGRAM
"""
TWO_PROGRAMS = """PROGRAM FAST
VAR count : INT; lamp : BOOL; END_VAR
  LD count
  ADD 1
  ST count
END_PROGRAM
PROGRAM SLOW
VAR count : INT; button AT %IX0.1 : BOOL; lamp AT %QX0.1 : BOOL; END_VAR
  LD count
  ADD 1
  ST count
  LD button
  ST lamp
END_PROGRAM
"""
MIRROR = """PROGRAM MAIN
VAR a AT %IX0.0 : BOOL; b AT %QX0.0 : BOOL; END_VAR
  LD a
  ST b
END_PROGRAM
"""


def starter(**options: object) -> plcemu.Plc:
    return plcemu.Plc(plcemu.compile(STARTER), **options)  # type: ignore[arg-type]


def test_the_example_of_the_readme_holds() -> None:
    plc = starter(cycle="10ms", record=True)
    plc["start"] = True
    plc.run_for("3s")
    assert plc["pump"] and plc.t_ns == 3 * S
    verdict = plcemu.Monitor("G (start -> F[0s,2s] pump)").check(plc.trace).verdict
    assert verdict == "presumably satisfied"


# values by name


@pytest.mark.parametrize("name", ["start", "START", "MAIN.start", "main.Start", "%IX0.0", "%ix0.0",
                                  " start "])
def test_a_value_goes_by_short_name_full_name_or_address(name: str) -> None:
    plc = starter()
    plc[name] = True
    assert plc["start"] is True
    assert plc[name] is True


def test_parts_of_function_blocks_have_names() -> None:
    plc = starter()
    plc["start"] = True
    plc.scan(2)
    assert plc["delay.ET"] == plc["MAIN.delay.ET"] == 10 * MS


def test_an_address_without_a_variable_holds_what_clients_put_there() -> None:
    plc = starter()
    plc["%QW700"] = 0xABCD
    plc["%MX3.4"] = True
    plc.scan()
    assert (plc["%QW700"], plc["%MX3.4"], plc["%MX3.5"], plc["%ML5"]) == (0xABCD, True, False, 0)


@pytest.mark.parametrize(("name", "said"), [
    ("strat", "there is no tag 'strat'; did you mean 'start'?"),
    ("MAIN.pmup", "there is no tag 'MAIN.pmup'; did you mean 'MAIN.pump'?"),
    ("%IX0.9", "'%IX0.9' has no such bit; bits go from 0 to 7"),
    ("%QW5000", "'%QW5000' is outside the process image; elements go from 0 to 1023"),
    ("%Z1", "'%Z1' is not an address"),
    ("", "there is no tag ''"),
])
def test_an_unknown_name_is_told_with_the_nearest(name: str, said: str) -> None:
    plc = starter()
    with pytest.raises(UnknownNameError) as reading:
        plc[name]
    with pytest.raises(UnknownNameError) as writing:
        plc[name] = True
    assert str(reading.value).startswith(said) and str(writing.value).startswith(said)
    assert isinstance(reading.value, KeyError)


def test_a_name_of_two_variables_is_told_with_both() -> None:
    plc = plcemu.Plc(TWO_PROGRAMS)
    with pytest.raises(UnknownNameError, match=r"'count' is not unique; .*FAST.count, SLOW.count"):
        plc["count"]
    assert plc["FAST.count"] == 0


def test_what_is_no_text_is_no_name() -> None:
    with pytest.raises(TypeError, match="5 is no name"):
        starter()[5]  # type: ignore[index]


@pytest.mark.parametrize(("name", "value", "said"), [
    ("start", 2, "start: 2 is not a value of type BOOL"),
    ("start", 0.5, "start: 0.5 is not a value of type BOOL"),
    ("count", 40_000, "count: 40000 is outside the range of INT"),
    ("count", 1.5, "count: 1.5 is not a value of type INT"),
    ("count", "many", "count: 'many' is not a value of type INT"),
    ("count", None, "count: None is not a value of type INT"),
    ("ratio", 1e300, "ratio: 1e\\+300 is outside the range of REAL"),
    ("pause", "soon", "pause: 'soon' is not a duration"),
    ("%QW9", -1, "%QW9: -1 is outside the range of WORD"),
])
def test_a_value_of_the_wrong_type_is_refused(name: str, value: object, said: str) -> None:
    plc = starter()
    with pytest.raises(ValueError, match=f"^{said}"):
        plc[name] = value  # type: ignore[assignment]
    with pytest.raises(PlcemuError):
        plc[name] = value  # type: ignore[assignment]


@pytest.mark.parametrize("text", ["1.5s", "T#1s500ms", "1500ms", 1_500_000_000])
def test_a_duration_may_be_a_text(text: str | int) -> None:
    plc = starter()
    plc["pause"] = text
    assert plc["pause"] == 1_500_000_000


def test_tags_of_the_cycle_are_read_like_any_other() -> None:
    plc = starter()
    plc.scan()
    assert plc["task.overruns"] == plc["task.missed"] == plc["missed"] == 0
    assert all(plc[tag.name] is not None for tag in plc.tags)


def test_a_program_s_own_variable_goes_before_a_tag_of_the_cycle() -> None:
    plc = plcemu.Plc(STARTER.replace("count", "overruns"))
    plc["start"] = True
    plc.scan(3)
    assert (plc["overruns"], plc["task.overruns"]) == (3, 0)


def test_tags_of_the_cycle_cannot_be_written() -> None:
    plc = starter()
    with pytest.raises(UnknownNameError):
        plc["task.overruns"] = 5


def test_a_program_with_a_taken_name_is_told() -> None:
    with pytest.raises(PlcemuError, match=r"two tags 'task\.overruns'; the names plant, "):
        plcemu.Plc(STARTER.replace("MAIN", "task").replace("count", "overruns"))


def test_the_tag_table_holds_names_types_and_addresses() -> None:
    tag = starter().tags["pump"]
    assert (tag.name, tag.type, tag.address) == ("MAIN.pump", "BOOL", "%QX0.0")


# writes and scans


def test_a_write_is_seen_by_its_writer_at_once_and_by_the_program_from_the_next_scan() -> None:
    plc = plcemu.Plc(MIRROR)
    plc["a"] = True
    assert (plc["a"], plc["b"]) == (True, False)
    plc.scan()
    assert (plc["a"], plc["b"]) == (True, True)


def test_the_last_of_several_writes_counts() -> None:
    plc = plcemu.Plc(MIRROR)
    plc["a"] = True
    plc["%IX0.0"] = False
    plc.scan()
    assert plc["b"] is False


def test_a_write_to_a_variable_without_address_is_latched_too() -> None:
    plc = starter()
    plc["count"] = 41
    plc["start"] = True
    plc.scan()
    assert plc["count"] == 42


def test_a_write_to_an_output_lasts_until_the_program_writes_it() -> None:
    plc = starter()
    plc["pump"] = True
    plc.scan()
    assert plc["pump"] is False


def test_neighbouring_bits_are_left_alone() -> None:
    plc = starter()
    plc["%IX0.1"] = True
    plc["start"] = True
    plc.scan()
    plc["start"] = False
    plc.scan()
    assert (plc["%IX0.0"], plc["%IX0.1"]) == (False, True)


# forces


def test_a_force_holds_an_input_whoever_writes_it() -> None:
    plc = plcemu.Plc(MIRROR)
    plc.force("a", True)
    plc["a"] = False
    plc.scan()
    assert plc["b"] is True


def test_a_force_holds_an_output_against_the_program() -> None:
    plc = starter()
    plc.force("pump", True)
    plc.scan(3)
    assert plc["pump"] is True
    plc.unforce("pump")
    plc.scan()
    assert plc["pump"] is False


def test_a_force_counts_in_a_run_that_skips() -> None:
    tasks = [Task("fast", 10 * MS, 0, 0, ("FAST",)), Task("slow", 70 * MS, 1, 0, ("SLOW",))]
    program = plcemu.compile(TWO_PROGRAMS.replace("LD count\n  ADD 1\n  ST count\n", ""))
    plc = plcemu.Plc(program, tasks=tasks)
    plc.run_for("80ms")
    plc.force("button", True)
    plc.run_for("1s")
    assert plc["SLOW.lamp"] is True


def test_unforcing_what_is_not_forced_does_nothing() -> None:
    starter().unforce("pump")


def test_what_is_unknown_cannot_be_forced() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'pump'"):
        starter().force("pmup", True)
    with pytest.raises(ValueError, match=r"^pump: 7 is not a value of type BOOL"):
        starter().force("pump", 7)


# time


def test_the_first_scan_runs_at_0_and_each_takes_a_cycle() -> None:
    plc = starter(cycle="7ms")
    assert plc.t_ns == 0
    plc.scan()
    assert plc.t_ns == 7 * MS
    plc.scan(100)
    assert plc.t_ns == 707 * MS


def test_run_for_executes_the_releases_of_a_stretch() -> None:
    plc = starter(cycle="10ms")
    plc["start"] = True
    plc.run_for("100ms")
    assert (plc["count"], plc.t_ns) == (10, 100 * MS)
    plc.run_for(50 * MS)
    assert (plc["count"], plc.t_ns) == (15, 150 * MS)


def test_a_stretch_that_is_no_multiple_of_the_cycle_ends_before_the_next_release() -> None:
    plc = starter(cycle="7ms")
    plc["start"] = True
    plc.run_for("10ms")
    assert (plc["count"], plc.t_ns) == (2, 14 * MS)


def test_scans_and_runs_may_take_turns() -> None:
    plc = starter()
    plc["start"] = True
    for _ in range(3):
        plc.run_for("50ms")
        plc.scan()
    assert (plc["count"], plc.t_ns) == (18, 180 * MS)


def test_a_run_of_no_time_executes_nothing() -> None:
    plc = starter()
    plc.run_for(0)
    plc.run_for("-1s")
    plc.scan(0)
    assert plc.t_ns == 0


@pytest.mark.parametrize("duration", ["3", "soon", 2.5, True])
def test_a_duration_needs_a_unit(duration: str) -> None:
    with pytest.raises(DurationError):
        starter().run_for(duration)


@pytest.mark.parametrize("cycle", [0, -5, "0s", "-1ms"])
def test_a_cycle_takes_time(cycle: str | int) -> None:
    with pytest.raises(PlcemuError, match="must be positive"):
        starter(cycle=cycle)


def test_an_unknown_engine_is_told() -> None:
    with pytest.raises(PlcemuError, match="there is no engine 'steam'; choose one of"):
        starter(engine="steam")


def test_tasks_run_at_their_own_intervals() -> None:
    tasks = [Task("fast", 2 * MS, 0, 0, ("FAST",)), Task("slow", 5 * MS, 1, 1 * MS, ("SLOW",))]
    plc = plcemu.Plc(TWO_PROGRAMS, tasks=tasks)
    plc.run_for("20ms")
    assert (plc["FAST.count"], plc["SLOW.count"]) == (10, 4)


# state


def test_a_division_by_zero_is_a_fault_with_safe_outputs() -> None:
    plc = plcemu.Plc(DIVIDER, record=True)
    plc.scan(5)
    assert (plc.state, plc["out"], plc.fault) == ("RUN", True, "")
    plc["go"] = True
    plc.scan()
    assert (plc.state, plc["out"], plc["a"]) == ("FAULT", False, 6)
    assert "MAIN" in plc.fault and "t = 0.050 s" in plc.fault
    plc.scan(10)
    assert (plc["a"], plc.t_ns) == (6, 160 * MS)
    assert plc.trace.history("out")[-1] == (50 * MS, False)


def test_in_a_fault_the_world_still_reads_and_writes() -> None:
    plc = plcemu.Plc(DIVIDER)
    plc["go"] = True
    plc.scan()
    plc["%QW5"] = 7
    plc.scan()
    assert (plc.state, plc["%QW5"], plc["go"]) == ("FAULT", 7, True)


def test_a_configured_safe_value_is_taken_in_fault_and_stop() -> None:
    plc = plcemu.Plc(DIVIDER, safe_outputs={"out": True})
    plc.stop()
    assert (plc.state, plc["out"]) == ("STOP", True)
    plc.resume()
    plc["go"] = True
    plc.scan()
    assert (plc.state, plc["out"]) == ("FAULT", True)


def test_in_stop_nothing_runs_and_time_goes_on() -> None:
    plc = starter()
    plc["start"] = True
    plc.scan(5)
    plc.stop()
    plc.scan(5)
    assert (plc.state, plc["count"], plc.t_ns) == ("STOP", 5, 100 * MS)
    plc.resume()
    plc.scan()
    assert (plc.state, plc["count"]) == ("RUN", 6)


def test_a_cold_start_begins_with_initial_values() -> None:
    plc = plcemu.Plc(DIVIDER)
    plc["go"] = True
    plc.scan()
    plc.restart(cold=True)
    assert (plc.state, plc.fault, plc["a"], plc["out"]) == ("RUN", "", 0, True)


def test_a_snapshot_is_bytes_and_restores_everything() -> None:
    plc = starter()
    plc["start"] = True
    plc.scan(10)
    image = plc.snapshot()
    plc.run_for("5s")
    assert isinstance(image, bytes)
    plc.restore(image)
    assert (plc["count"], plc["pump"], plc["delay.ET"]) == (10, False, 90 * MS)
    assert plc.snapshot() == image


def test_from_the_same_snapshot_the_same_follows() -> None:
    plc = starter()
    plc["start"] = True
    plc.scan(10)
    image = plc.snapshot()
    plc.run_for("5s")
    first = plc.snapshot()
    plc.restore(image)
    plc.run_for("5s")
    assert plc.snapshot() == first


def test_the_snapshot_of_another_program_is_refused() -> None:
    with pytest.raises(ValueError, match="it is of another program"):
        starter().restore(plcemu.Plc(MIRROR).snapshot())


def test_a_fork_goes_its_own_way() -> None:
    plc = starter()
    plc["start"] = True
    plc.scan(5)
    twin = plc.fork()
    twin["start"] = False
    twin.scan(3)
    plc.scan()
    assert (plc["count"], plc.t_ns) == (6, 60 * MS)
    assert (twin["count"], twin.t_ns) == (5, 80 * MS)


def test_a_fork_does_what_its_original_does() -> None:
    plc = starter()
    plc["start"] = True
    plc["%QW700"] = 3
    plc.force("speed", 9)
    plc.scan(150)
    twin = plc.fork()
    plc.run_for("2s")
    twin.run_for("2s")
    assert twin.snapshot() == plc.snapshot()
    assert (twin["%QW700"], twin["speed"], twin.t_ns) == (3, 9, plc.t_ns)


def test_a_fork_has_the_writes_that_still_wait() -> None:
    plc = plcemu.Plc(MIRROR)
    plc.scan()
    plc["a"] = True
    twin = plc.fork()
    assert twin["a"] is True
    twin.scan()
    assert (twin["b"], plc["b"]) == (True, False)


def test_a_fork_has_no_writes_that_were_latched() -> None:
    plc = plcemu.Plc(MIRROR)
    plc["a"] = True
    plc.scan()
    plc["%QW9"] = 1
    plc.scan()
    assert plc.fork()["%QW9"] == 1


def test_a_fork_of_a_fault_is_in_fault() -> None:
    plc = plcemu.Plc(DIVIDER)
    plc["go"] = True
    plc.scan()
    twin = plc.fork()
    assert (twin.state, twin.fault) == ("FAULT", plc.fault)


# traces


def test_the_first_frame_is_complete_and_the_others_are_differences() -> None:
    plc = starter(record=True)
    plc["start"] = True
    plc.scan(3)
    first, second, third = plc.trace.frames
    assert [i for i, _ in first.changes] == list(range(len(plc.tags)))
    names = {plc.tags[i].name for i, _ in second.changes}
    assert names == {"MAIN.count", "MAIN.delay.ET"}
    assert (second.t_ns, second.scan, third.scan) == (10 * MS, 1, 2)


def test_a_scan_that_changes_nothing_leaves_no_frame() -> None:
    plc = starter(record=True)
    plc.run_for("10s")
    assert [f.t_ns for f in plc.trace.frames] == [0]


def test_a_trace_tells_of_the_time_up_to_the_next_release() -> None:
    plc, dense = starter(record=True), starter(record=True)
    plc.run_for("10s")
    dense.scan(1000)
    assert plc.trace.end_ns == dense.trace.end_ns == 10 * S - 1


def test_a_demand_with_its_deadline_at_the_next_release_is_still_open() -> None:
    plc = starter(record=True)
    plc["start"] = True
    plc.run_for("2s")
    monitor = plcemu.Monitor("G (start -> F[0s,2s] pump)")
    assert monitor.check(plc.trace).verdict == "presumably violated"
    plc.run_for("10ms")
    assert monitor.check(plc.trace).verdict == "presumably satisfied"


def test_a_missed_deadline_in_a_quiet_stretch_is_violated() -> None:
    plc = starter(record=True)
    plc.run_for("10s")
    result = plcemu.Monitor("F[0s,5s] pump").check(plc.trace)
    assert (result.verdict, result.decided_at_ns) == ("violated", 5 * S)


def test_without_recording_there_is_no_trace() -> None:
    with pytest.raises(ValueError, match="record=True"):
        _ = starter().trace


def test_a_fork_records_from_its_own_first_scan() -> None:
    plc = starter(record=True)
    plc.scan(5)
    twin = plc.fork()
    twin.scan(2)
    assert [(f.t_ns, f.scan) for f in twin.trace.frames] == [(50 * MS, 5)]
    assert len(twin.trace.frames[0].changes) == len(plc.tags)


# compiling


def test_text_path_and_list_of_paths_compile_alike(tmp_path: Path) -> None:
    path = tmp_path / "a.il"
    path.write_text(STARTER)
    programs = [plcemu.compile(s) for s in (STARTER, path, [path])]
    assert len({p.layout.initial for p in programs}) == 1
    assert plcemu.Plc(path)["count"] == 0


def test_a_mistake_comes_with_diagnostics() -> None:
    with pytest.raises(plcemu.CompileError) as caught:
        plcemu.compile(STARTER.replace("LD  delay.Q", "LDD delay.Q"))
    assert caught.value.diagnostics
    assert str(caught.value).startswith("<text>:5:")


def test_what_is_not_there_is_told_like_by_any_module() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = plcemu.nonsense
