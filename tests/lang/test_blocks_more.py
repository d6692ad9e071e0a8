"""Typed counters, timers with LTIME, SEMA and RTC; instances in structures, arrays and calls."""

import pytest
from controller import MS, Controller, findings, main

DATE_NS = 1_709_164_799 * 1000 * MS
"""2024-02-28 23:59:59, in ns from 1970-01-01."""


@pytest.mark.parametrize(("of", "low", "high"), [
    ("SINT", -2**7, 2**7 - 1), ("INT", -2**15, 2**15 - 1), ("DINT", -2**31, 2**31 - 1),
    ("LINT", -2**63, 2**63 - 1), ("USINT", 0, 2**8 - 1), ("UINT", 0, 2**16 - 1),
    ("UDINT", 0, 2**32 - 1), ("ULINT", 0, 2**64 - 1)])
def test_typed_counters_stop_at_the_limits_of_their_type(of, low, high):
    text = main(f"u : CTU_{of}; d : CTD_{of}; b : CTUD_{of}; x : BOOL; n : {of};",
                "x := NOT x; u(CU := x, PV := 3); d(CD := x); b(CU := x, PV := n);"
                " n := u.CV;")
    controller = Controller(text)
    controller["u.CV"], controller["d.CV"], controller["b.CV"] = high - 1, low + 1, high
    controller.scan(9)
    assert (controller["u.CV"], controller["d.CV"], controller["b.CV"]) == (high, low, high)
    assert controller["n"] == high
    assert controller["u.Q"] and controller["d.Q"] and controller["b.QU"]


def test_a_counter_of_lint_takes_a_preset_that_no_int_holds():
    controller = Controller(main("d : CTD_LINT; n : LINT := 5000000000;",
                                 "d(CD := FALSE, LD := TRUE, PV := n);")).scan()
    assert controller["d.CV"] == 5_000_000_000


@pytest.mark.parametrize(("block", "line", "q"), [
    ("TON", "_-------_", "____----_"), ("TOF", "_--______", "_-----___"),
    ("TP", "_-_______", "_---_____")])
@pytest.mark.parametrize(("suffix", "of"), [("", "TIME"), ("_TIME", "TIME"), ("_LTIME", "LTIME"),
                                            ("", "LTIME")])
def test_timers_run_with_time_and_ltime_alike(block, line, q, suffix, of):
    text = main(f"t : {block}{suffix}; a : BOOL; e : {of}; p : {of} := {of}#30ms;",
                "t(IN := a, PT := p, ET => e);")
    controller = Controller(text)
    assert controller.diagram({"a": line}, ["t.Q"]) == {"t.Q": q}


def test_sema_tells_a_second_claimant_that_it_is_busy_until_it_is_released():
    text = main("s : SEMA; c, r : BOOL;", "s(CLAIM := c, RELEASE := r);")
    controller = Controller(text)
    assert controller.diagram({"c": "_--___-_", "r": "____-_--"}, ["s.BUSY"]) == \
        {"s.BUSY": "__--____"}


def test_rtc_runs_from_its_preset_while_in_is_true():
    text = main("c : RTC; a : BOOL; d : DT := DT#2024-02-28-23:59:59; now : DT; n : INT;",
                "n := n + 1; IF n < 5 THEN c(IN := a, PDT := d); END_IF;"
                " IF n >= 8 THEN c(IN := a); END_IF; now := c.CDT;")
    controller = Controller(text, cycle_ns=500 * MS).scan()
    assert not controller["c.Q"]
    controller["a"] = True
    assert controller.values(3, "now") == [DATE_NS + n * 500 * MS for n in range(3)]
    assert controller.values(4, "now")[-1] == DATE_NS + 3000 * MS
    controller["a"] = False
    assert controller.values(2, "now") == [DATE_NS + 3000 * MS] * 2
    controller["a"] = True
    assert controller.scan()["now"] == DATE_NS


def test_an_instance_has_initial_values_of_its_own():
    controller = Controller(main("t : TON := (PT := T#20ms); q : BOOL;",
                                 "t(IN := TRUE); q := t.Q;"))
    assert controller.lines(4, ["q"]) == {"q": "__--"}


def test_instances_stand_in_structures_and_arrays():
    text = ("TYPE pump : STRUCT run : TON; starts : ARRAY[1..2] OF CTU; END_STRUCT END_TYPE\n"
            + main("p : ARRAY[0..1] OF pump; i : INT; q : BOOL; n : INT;",
                   "FOR i := 0 TO 1 DO p[i].run(IN := i = 1, PT := T#10ms);"
                   " p[i].starts[2](CU := p[i].run.Q, PV := 1); END_FOR;"
                   " q := p[1].starts[2].Q; n := p[0].starts[2].CV;"))
    controller = Controller(text)
    assert controller.lines(3, ["q"]) == {"q": "_--"}
    assert controller["n"] == 0


def test_inputs_of_an_instance_are_read_and_written_from_outside():
    controller = Controller(main("c : CTU; x : BOOL; n : INT;",
                                 "x := NOT x; c.PV := 2; c.CU := x; c(); n := c.PV + c.CV;"))
    assert controller.values(4, "n") == [3, 3, 4, 4]


def test_instances_are_global_and_may_use_other_global_variables():
    text = ("VAR_GLOBAL one : adder; two : ARRAY[0..1] OF adder; END_VAR\n"
            "FUNCTION_BLOCK adder VAR_EXTERNAL step_by : INT; END_VAR VAR_OUTPUT n : INT; END_VAR "
            "n := n + step_by; END_FUNCTION_BLOCK\n"
            "VAR_GLOBAL step_by : INT := 3; END_VAR\n"
            "PROGRAM MAIN VAR_EXTERNAL one : adder; two : ARRAY[0..1] OF adder; END_VAR "
            "VAR n : INT; END_VAR one(); two[1](); n := one.n + two[1].n; END_PROGRAM\n")
    assert Controller(text).values(3, "MAIN.n") == [6, 12, 18]
    assert findings(text) == []


@pytest.mark.parametrize(("body", "expected"), [
    ("c.CV := 5; c();", "5:1: P0024"), ("c(CV := 5);", "5:3: P0026"),
    ("c(); IF c.__before THEN c(); END_IF;", "5:9: P0020"),
    ("c(CU => x);", "5:3: P0026")])
def test_outputs_are_not_written_and_locals_not_read_from_outside(body, expected):
    assert [f for f in findings(main("c : CTU; x : BOOL;", body)) if "P0070" not in f] == [expected]


def test_instances_are_handed_on_as_in_outs_and_nest_in_user_blocks():
    text = ("FUNCTION_BLOCK watch VAR_INPUT x : BOOL; END_VAR VAR_IN_OUT t : TON; END_VAR "
            "VAR_OUTPUT late : BOOL; END_VAR t(IN := x, PT := T#10ms); late := t.Q; "
            "END_FUNCTION_BLOCK\n"
            "FUNCTION tell : BOOL VAR_IN_OUT t : TON; END_VAR tell := t.Q; END_FUNCTION\n"
            "FUNCTION_BLOCK pair VAR one : watch; two : TON; END_VAR VAR_OUTPUT q : BOOL; END_VAR "
            "one(x := TRUE, t := two); q := one.late; END_FUNCTION_BLOCK\n"
            + main("p : pair; w : watch; t : TON; q, r, s : BOOL;",
                   "p(q => q); w(x := TRUE, t := t); r := w.late; s := tell(t);"))
    controller = Controller(text)
    assert controller.lines(3, ["q", "r", "s"]) == {"q": "_--", "r": "_--", "s": "_--"}
    assert findings(text) == []
