"""Online change: what an edited program still has keeps its value, all else is initial."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from systems import S, system_of

import plcemu
from plcemu.base.errors import CompileError, ConfigError, PlcemuError
from plcemu.monitor.parse import parse_properties
from plcemu.runtime.change import Change
from plcemu.runtime.config import load_config
from plcemu.runtime.plc import Plc


def main(variables: str, body: str = ";", more: str = "") -> str:
    return f"{more}\nPROGRAM MAIN\nVAR {variables} END_VAR\n{body}\nEND_PROGRAM\n"


# ---------------------------------------------------------------- values


def test_values_of_the_same_name_and_type_stay_and_new_ones_are_initial():
    plc = Plc(main("a : INT := 1; b : INT := 2;", "a := a + 1;"))
    plc.scan(9)
    report = plc.change(main("c : REAL := 0.5; b : DINT := 7; a : INT := 100;", "a := a + 1;"))
    assert (plc["a"], plc["b"], plc["c"]) == (10, 7, 0.5)
    assert (report.kept, report.added, report.dropped) == (
        ("MAIN.a",), ("MAIN.c", "MAIN.b"), ("MAIN.b",))
    plc.scan()
    assert plc["a"] == 11


def test_a_running_timer_goes_on_where_it_was():
    text = main("t : TON; done : BOOL;", "t(IN := TRUE, PT := T#1s); done := t.Q;")
    plc = Plc(text)
    plc.run_for("600ms")
    plc.change(text.replace("done : BOOL;", "x : LINT; done : BOOL; y : INT;"))
    plc.run_for("400ms")
    assert not plc["done"]
    plc.run_for("20ms")
    assert plc["done"] and plc.t_ns == 1_020_000_000


def test_an_edited_constant_has_its_new_value():
    plc = Plc("PROGRAM MAIN VAR CONSTANT k : INT := 5; END_VAR VAR n : INT; END_VAR n := k; "
              "END_PROGRAM")
    plc.scan()
    plc.change("PROGRAM MAIN VAR CONSTANT k : INT := 6; END_VAR VAR n : INT; END_VAR n := k; "
               "END_PROGRAM")
    assert plc["n"] == 5
    plc.scan()
    assert plc["n"] == 6


def test_an_enumeration_whose_numbers_changed_is_not_misread():
    plc = Plc(main("c : C; n : INT;", "c := GREEN;", "TYPE C : (RED, GREEN); END_TYPE"))
    plc.scan()
    report = plc.change(main("c : C; n : INT;", ";", "TYPE C : (RED, BLUE, GREEN); END_TYPE"))
    assert plc["c"] == 0 and report.dropped == ("MAIN.c",)


def test_a_function_block_keeps_the_variables_that_it_still_has():
    block = "FUNCTION_BLOCK F VAR_OUTPUT {} END_VAR n := n + 1; END_FUNCTION_BLOCK"
    plc = Plc(main("f : F;", "f();", block.format("n : INT;")))
    plc.scan(3)
    report = plc.change(main("f : F;", "f();", block.format("m : BOOL := TRUE; n : INT;")))
    assert (plc["f.n"], plc["f.m"]) == (3, True)
    assert (report.kept, report.added) == (("MAIN.f.n",), ("MAIN.f.m",))


def test_a_block_of_another_type_starts_anew_though_its_fields_have_the_same_names():
    plc = Plc(main("t : TON;", "t(IN := TRUE, PT := T#1s);"))
    plc.run_for("500ms")
    plc.change(main("t : TOF;", "t(IN := TRUE, PT := T#1s);"))
    assert plc["t.IN"] is False


def test_var_in_out_works_after_its_variable_moved():
    block = "FUNCTION_BLOCK F VAR_IN_OUT x : INT; END_VAR x := x + 1; END_FUNCTION_BLOCK"
    plc = Plc(main("f : F; n : INT;", "f(x := n);", block))
    plc.scan(2)
    plc.change(main("pad : ARRAY[0..99] OF LINT; f : F; n : INT;", "f(x := n);", block))
    plc.scan(2)
    assert plc["n"] == 4


NAMES = ("a", "b", "c", "d", "e")
TYPES = {"INT": 3, "DINT": 4, "LINT": 5, "BYTE": 6, "ULINT": 7}
DECLARED = st.dictionaries(st.sampled_from(NAMES), st.sampled_from(sorted(TYPES)), min_size=1)


def text_of(declared: dict[str, str], order: list[str]) -> str:
    return main(" ".join(f"{name} : {declared[name]} := {TYPES[declared[name]]};"
                         for name in order if name in declared))


@settings(max_examples=40)
@given(DECLARED, DECLARED, st.permutations(NAMES), st.permutations(NAMES),
       st.lists(st.integers(10, 99), min_size=5, max_size=5))
def test_after_any_edit_kept_values_are_the_old_ones_and_others_initial(
        old, new, order, other_order, values):
    plc = Plc(text_of(old, order))
    written = dict(zip(NAMES, values, strict=True))
    for name in old:
        plc[name] = written[name]
    plc.scan()
    report = plc.change(text_of(new, other_order))
    same = {name for name in new if old.get(name) == new[name]}
    assert {n.removeprefix("MAIN.") for n in report.kept} == same
    assert {n.removeprefix("MAIN.") for n in report.added} == set(new) - same
    assert {n.removeprefix("MAIN.") for n in report.dropped} == set(old) - same
    assert {n: plc[n] for n in new} == {
        n: written[n] if n in same else TYPES[new[n]] for n in new}


@settings(max_examples=20)
@given(st.integers(0, 30), st.integers(0, 30))
def test_a_change_to_the_same_program_changes_nothing(before, after):
    text = main("n : INT; t : TON; x AT %QW0 : INT;",
                "n := n + 1; t(IN := n MOD 7 <> 0, PT := T#30ms); x := n; IF t.Q THEN n := n + 1; "
                "END_IF;")
    plain, changed = Plc(text), Plc(text)
    plain.scan(before + after)
    changed.scan(before)
    report = changed.change(text)
    changed.scan(after)
    assert (report.added, report.dropped) == ((), ())
    assert plain.snapshot() == changed.snapshot() and plain.t_ns == changed.t_ns


# ---------------------------------------------------------------- the image


def test_inputs_and_what_clients_wrote_stay_also_where_the_old_program_used_nothing():
    plc = Plc(main("a AT %IW0 : INT; o : INT;", "o := a;"))
    plc["%IW0"], plc["%IW5"], plc["%MW9"] = 11, 12, 13
    plc.scan()
    plc.change(main("b AT %IW5 : INT; o : INT; p : WORD; m : WORD;",
                    "o := b; p := %IW0; m := %MW9;"))
    plc.scan()
    assert (plc["o"], plc["p"], plc["m"]) == (12, 11, 13)


def test_a_located_variable_keeps_its_value_at_another_address():
    plc = Plc(main("x AT %MW0 : INT;", "x := x + 1;"))
    plc.scan(4)
    plc.change(main("x AT %MW7 : INT;", "x := x + 1;"))
    assert plc["%MW7"] == 4
    plc.scan()
    assert plc["x"] == 5


def test_a_write_that_waits_is_not_lost():
    plc = Plc(main("a : INT; b : INT;"))
    plc["b"] = 5
    plc.change(main("z : LINT; a : INT; b : INT;"))
    assert plc["b"] == 5


def test_forces_hold_on_what_is_kept_and_end_on_what_is_not():
    text = main("a AT %IX0.3 : BOOL; b : INT; c : INT; out : BOOL;", "b := 1; c := 1; out := a;")
    plc = Plc(text)
    plc.force("a", True)
    plc.force("b", 9)
    plc.force("c", 9)
    plc.scan()
    report = plc.change(text.replace("c : INT", "pad : LINT; c : DINT"))
    plc.scan()
    assert (plc["out"], plc["b"], plc["c"]) == (True, 9, 1)
    assert report.ended_forces == ("MAIN.c",)
    plc.unforce("b")
    plc.scan()
    assert plc["b"] == 1


# ---------------------------------------------------------------- charts


CHART = """PROGRAM MAIN
VAR go : BOOL; n : INT; END_VAR
INITIAL_STEP START: END_STEP
TRANSITION FROM START TO {one} := go; END_TRANSITION
STEP {one}: COUNT(N); END_STEP
TRANSITION FROM {one} TO START := NOT go; END_TRANSITION
ACTION COUNT: n := n + 1; END_ACTION
END_PROGRAM
"""


def at_work() -> Plc:
    plc = Plc(CHART.format(one="FILL"))
    plc.scan()
    plc["go"] = True
    plc.scan(5)
    assert plc["FILL.X"]
    return plc


def test_an_active_step_stays_active_with_its_time():
    plc = at_work()
    elapsed = plc["FILL.T"]
    report = plc.change(CHART.format(one="FILL").replace("n + 1", "n + 10"))
    assert plc["FILL.X"] and plc["FILL.T"] == elapsed and report.restarted_charts == ()
    before = plc["n"]
    plc.scan()
    assert plc["n"] == before + 10


def test_a_chart_whose_only_active_step_is_gone_takes_its_initial_situation():
    plc = at_work()
    report = plc.change(CHART.format(one="DRAIN"))
    assert report.left_steps == ("MAIN.FILL",) and report.restarted_charts == ("MAIN",)
    plc.scan()
    assert plc["START.X"] and not plc["DRAIN.X"]
    plc.scan()
    assert plc["DRAIN.X"]


# ---------------------------------------------------------------- refusals


def test_a_text_with_mistakes_leaves_the_plc_as_it_was():
    plc = Plc(main("n : INT;", "n := n + 1;"), record=True)
    plc.scan(3)
    image, tags = plc.snapshot(), list(plc.tags)
    with pytest.raises(CompileError) as refused:
        plc.change(main("n : INT;", "n := nix; m := 1;"))
    assert len(refused.value.diagnostics) >= 2
    assert (plc.snapshot(), list(plc.tags)) == (image, tags)
    plc.scan()
    assert plc["n"] == 4


def test_a_safe_output_that_is_no_more_refuses_the_change():
    plc = Plc(main("o AT %QW0 : INT;", "o := 5;"), safe_outputs={"o": 1})
    with pytest.raises(PlcemuError, match="'o'"):
        plc.change(main("p AT %QW0 : INT;", "p := 5;"))
    plc.scan()
    assert plc["o"] == 5


@pytest.mark.parametrize(("config", "program", "says"), [
    ("tasks: {t: {interval: 10ms, programs: MAIN}}", ("PROGRAM OTHER VAR n : INT; END_VAR n := 1; "
     "END_PROGRAM"), "OTHER"),
    ("safe_outputs: {pump: true}", ("PROGRAM MAIN VAR pump AT %MX0.0 : BOOL; END_VAR pump := TRUE; "
     "END_PROGRAM"), "an output")])
def test_a_system_refuses_what_its_configuration_does_not_fit(tmp_path: Path, config, program,
                                                              says):
    system = system_of(tmp_path, config)
    (tmp_path / "main.il").write_text(program)
    with pytest.raises(ConfigError, match=says):
        system.prepare_change(system.config)
    system.cycle.lap()
    assert "MAIN.count" in system.cycle.tags


def test_a_property_that_no_longer_binds_refuses_the_change(tmp_path: Path):
    (tmp_path / "p.prop").write_text('counts: G count >= 0\n')
    system = system_of(tmp_path, "properties: p.prop")
    (tmp_path / "main.il").write_text("PROGRAM MAIN VAR n : INT; END_VAR LD 1 ST n END_PROGRAM")
    with pytest.raises(CompileError, match="count"):
        system.prepare_change(system.config)


# ---------------------------------------------------------------- monitors, records, time


def changed(plc: Plc, text: str, properties: str) -> Change:
    """Prepare a change by hand, with properties of its own."""
    from plcemu.engine.resource import Resource
    from plcemu.lang.compile import compile_program

    resource = Resource(compile_program(text), plc._arguments[1])
    return Change(plc._cycle, resource, parse_properties(properties))


def test_monitors_whose_meaning_stays_go_on_and_others_start_anew(tmp_path: Path):
    (tmp_path / "p.prop").write_text("late: G (start -> F[0s,1s] pump)\n"
                                     "small: G count < 1000\nonce: O[0s,9s] start\n")
    system = system_of(tmp_path, "properties: p.prop\ncycle: 100ms")
    system.exchange.port("test").write("IX", 0, b"\1")
    system.cycle.run_virtual(S // 2)
    edited = (tmp_path / "main.il").read_text().replace("count : INT", "more : INT; count : DINT")
    (tmp_path / "main.il").write_text(edited.replace("CAL delay", "LD 1\n  ST more\n  CAL delay")
                                      .replace("LD  count\n  ADD 1", "LD  count\n  ADD 1"))
    report = system.prepare_change(load_config(tmp_path / "config.yaml")).apply()
    assert report.restarted_properties == ("small",)
    system.cycle.run_virtual(4 * S)
    verdicts = {r.name: r for r in system.cycle.suite.results()}
    assert verdicts["late"].verdict.value == "violated"
    assert verdicts["late"].decided_at_ns == 1 * S, "the obligation of before the change counts"
    assert verdicts["small"].verdict.value == "presumably satisfied"
    assert system.report()["tags"]["monitor.late.verdict"] == "violated"


def test_a_recording_goes_on_if_the_tags_are_the_same_and_begins_anew_if_not():
    plc = Plc(main("n : INT;", "n := n + 1;"), record=True)
    plc.scan(2)
    assert not plc.change(main("n : INT;", "n := n + 2;")).is_recorded_anew
    plc.scan(1)
    assert [v for _, v in plc.trace.history("n")] == [1, 2, 4]
    assert plc.change(main("n : INT; m : INT;", "n := n + 2;")).is_recorded_anew
    plc.scan(1)
    assert [v for _, v in plc.trace.history("n")] == [6]
    assert [v for _, v in plc.earlier_traces[0].history("n")] == [1, 2, 4]


def test_many_changes_leave_no_past_suites_behind():
    plc = Plc(main("n : INT;", "n := n + 1;"))
    for k in range(20):
        plc.change(main(f"n : INT; m{k} : INT;", "n := n + 1;"))
        plc.scan()
    assert plc["n"] == 20 and len(plc._cycle.suite._members) == 1


def test_a_change_in_stop_stays_in_stop_and_in_fault_in_fault():
    plc = Plc(main("n : INT;", "n := n / 0;"))
    plc.scan()
    assert plc.state == "FAULT"
    plc.change(main("n : INT;", "n := n + 1;"))
    assert plc.state == "FAULT" and "zero" in plc.fault
    plc.resume()
    plc.scan()
    assert (plc.state, plc["n"]) == ("RUN", 1)


def test_a_fork_after_a_change_is_of_the_edited_program():
    plc = Plc(main("n : INT;", "n := n + 1;"), record=True)
    plc.scan(3)
    plc.change(main("n : INT; m : INT;", "n := n + 1; m := n;"))
    plc.scan()
    twin = plc.fork()
    twin.scan()
    assert (twin["m"], plc["m"]) == (5, 4)


# ---------------------------------------------------------------- retained variables


KEPT = "PROGRAM MAIN VAR RETAIN a : INT; END_VAR VAR b : INT; END_VAR {} END_PROGRAM"


def test_a_plc_takes_over_what_another_one_left(tmp_path: Path):
    one = Plc(KEPT.format("a := a + 1; b := a;"), retain=tmp_path / "kept")
    one.scan(5)
    two = Plc(KEPT.format("a := a + 1; b := a;"), retain=tmp_path / "kept")
    assert (two["a"], two["b"], two.retained()) == (5, 0, {"MAIN.a": 5})


def test_an_edited_program_takes_what_fits_and_says_what_it_dropped(tmp_path: Path):
    text = "PROGRAM MAIN VAR RETAIN a : INT; g : {}; END_VAR a := a + 1; g := 7; END_PROGRAM"
    Plc(text.format("INT"), retain=tmp_path / "kept").scan(5)
    edited = Plc(text.format("LINT"), retain=tmp_path / "kept")
    assert (edited["a"], edited["g"]) == (5, 0)
    assert edited.retain_problems == ["dropped, since they do not fit: MAIN.g"]


def test_non_retain_parts_of_what_is_retained_are_not(tmp_path: Path):
    text = """FUNCTION_BLOCK F VAR n : INT; END_VAR VAR NON_RETAIN m : INT; END_VAR
        n := n + 1; m := n; END_FUNCTION_BLOCK
        VAR_GLOBAL RETAIN g : INT; END_VAR VAR_GLOBAL NON_RETAIN h : INT; END_VAR
        PROGRAM MAIN VAR RETAIN f : F; END_VAR VAR_EXTERNAL g : INT; h : INT; END_VAR
        f(); g := g + 1; h := g; END_PROGRAM"""
    Plc(text, retain=tmp_path / "kept").scan(3)
    again = Plc(text, retain=tmp_path / "kept")
    assert (again["f.n"], again["f.m"], again["g"], again["h"]) == (3, 0, 3, 0)


def test_a_warm_restart_keeps_retained_variables_and_inputs_a_cold_one_inputs_alone():
    plc = plcemu.Plc(KEPT.format("a := a + 1; b := %IW0;").replace("b : INT", "b : WORD"))
    plc["%IW0"] = 4
    plc.scan(3)
    plc.restart()
    assert (plc["a"], plc["%IW0"]) == (3, 4)
    plc.scan()
    assert (plc["a"], plc["b"]) == (4, 4)
    plc.restart(cold=True)
    plc.scan()
    assert (plc["a"], plc["b"]) == (1, 4)
