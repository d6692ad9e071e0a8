"""Arithmetic on times and dates against Python's own (IEC 61131-3, table 30)."""

import datetime
from fractions import Fraction

import pytest
from controller import Controller, evaluate, findings, main
from hypothesis import given, settings
from hypothesis import strategies as st

DAY = 86_400 * 10**9
SMALL = st.integers(-40_000 * DAY, 40_000 * DAY)
TODS = st.integers(0, DAY - 1)
DATES = st.integers(-30_000, 40_000).map(lambda day: day * DAY)

ARITHMETIC = {
    "ADD_TIME": ("tt", "+", lambda a, b: a + b, "TIME"),
    "ADD_TOD_TIME": ("ct", "+", lambda a, b: (a + b) % DAY, "TOD"),
    "ADD_DT_TIME": ("mt", "+", lambda a, b: a + b, "DT"),
    "SUB_TIME": ("tt", "-", lambda a, b: a - b, "TIME"),
    "SUB_DATE_DATE": ("dd", "-", lambda a, b: a - b, "TIME"),
    "SUB_TOD_TIME": ("ct", "-", lambda a, b: (a - b) % DAY, "TOD"),
    "SUB_TOD_TOD": ("cc", "-", lambda a, b: a - b, "TIME"),
    "SUB_DT_TIME": ("mt", "-", lambda a, b: a - b, "DT"),
    "SUB_DT_DT": ("mm", "-", lambda a, b: a - b, "TIME"),
}
"""Functions with their operands' letters, operator, meaning and type."""

DECLARED = "t1 : TIME; t2 : TIME; c1 : TOD; c2 : TOD; m1 : DT; m2 : DT; d1 : DATE; d2 : DATE; "
LINES = [f"f{n} := {name}({x}1, {y}2); o{n} := {x}1 {op} {y}2; "
         f"n{n} := {name}(IN2 := {y}2, IN1 := {x}1);"
         for n, (name, ((x, y), op, _, _)) in enumerate(ARITHMETIC.items())]
PLC = Controller(main(DECLARED + "".join(
    f"f{n} : {of}; o{n} : {of}; n{n} : {of};" for n, (*_, of) in enumerate(ARITHMETIC.values())),
    "\n".join(LINES)))


@given(st.fixed_dictionaries({"t1": SMALL, "t2": SMALL, "c1": TODS, "c2": TODS, "m1": SMALL,
                              "m2": SMALL, "d1": DATES, "d2": DATES}))
@settings(max_examples=100, deadline=None)
def test_functions_and_operators_of_times_and_dates(values):
    for name, value in values.items():
        PLC[name] = value
    PLC.scan()
    expected = [fn(values[x + "1"], values[y + "2"]) for (x, y), _, fn, _ in ARITHMETIC.values()]
    for letter in "fon":
        assert [PLC[f"{letter}{n}"] for n in range(len(expected))] == expected


@given(SMALL, st.integers(-1000, 1000))
@settings(max_examples=60, deadline=None)
def test_a_time_is_scaled_by_a_whole_number(time, factor):
    SCALED["t"], SCALED["n"] = time, factor or 1
    SCALED.scan()
    quotient = abs(time) // abs(factor or 1) * (1 if (time < 0) == (factor < 0) else -1)
    product = (time * (factor or 1) + 2**63) % 2**64 - 2**63
    assert [SCALED[k] for k in ("a", "b", "c", "d")] == [product, product, quotient, quotient]


SCALED = Controller(main("t : TIME; n : INT; a : TIME; b : TIME; c : TIME; d : TIME;",
                         "a := t * n; b := MULTIME(t, n); c := t / n; d := DIVTIME(t, n);"))


@given(st.integers(-2**52, 2**52), st.floats(-100, 100).filter(lambda x: abs(x) > 1e-3))
@settings(max_examples=60, deadline=None)
def test_a_time_is_scaled_by_a_real_and_rounded_to_ns(time, factor):
    BY_REAL["t"], BY_REAL["x"] = time, factor
    BY_REAL.scan()
    assert [BY_REAL["a"], BY_REAL["b"]] == [round(time * factor)] * 2
    assert [BY_REAL["c"], BY_REAL["d"]] == [round(time / factor)] * 2


BY_REAL = Controller(main("t : TIME; x : LREAL; a : TIME; b : TIME; c : TIME; d : TIME;",
                          "a := t * x; b := MUL_TIME(t, x); c := t / x; d := DIV_TIME(t, x);"))


@pytest.mark.parametrize(("text", "ns"), [
    ("T#10s * 0.1", 10**9), ("T#10s / 4", 2_500_000_000), ("T#1s * REAL#2.5", 2_500_000_000),
    ("T#3ns / 2.0", 2), ("T#5ns / 2.0", 2), ("T#1s * 2 + T#1ms", 2_001_000_000),
    ("T#2s * USINT#3", 6 * 10**9), ("T#2s * ULINT#3", 6 * 10**9), ("T#-7ns / 2", -3),
    ("LT#1s - T#1ms", 999_000_000), ("-T#1s", -10**9), ("MAX(T#1s, T#2s)", 2 * 10**9),
    ("T#1s / REAL#3", 333_333_333),
])
def test_a_time_expression(text, ns):
    assert Fraction(evaluate("r : TIME;", f"r := {text};", "r")) == ns


def test_a_time_divided_by_nothing_is_a_fault():
    plc = Controller(main("x : REAL; n : INT; r : TIME;", "r := T#1s / x;")).scan()
    assert "no integer value" in str(plc.resource.fault)
    plc = Controller(main("n : INT; r : TIME;", "r := T#1s / n;")).scan()
    assert "division by zero" in str(plc.resource.fault)


@pytest.mark.parametrize("text", [
    "D#2024-01-01 + T#1s", "D#2024-01-01 - TOD#1:0:0", "DT#2024-01-01-1:2:3 * 2", "T#1s * T#1s",
    "5 / T#1s", "TOD#1:0:0 + TOD#1:0:0", "T#1s + 5", "D#2024-01-01 - DT#2024-01-01-1:2:3",
    "ADD_TIME(1, 2)", "ADD_TOD_TIME(T#1s, T#1s)", "SUB_DATE_DATE(T#1s, T#1s)",
    "MULTIME(2, T#1s)", "CONCAT_DATE_TOD(T#1s, T#1s)", "CONCAT_DATE(2024, 1.5, 1)",
    "DAY_OF_WEEK(T#1s)"])
def test_what_times_and_dates_do_not_do_is_reported(text):
    assert [f[-5:] for f in findings(main("r : BOOL;", f"r := {text};"))] == ["P0023"]


@pytest.mark.parametrize(("left", "op", "right", "value"), [
    ("D#2024-02-29", "<", "D#2024-03-01", True), ("TOD#1:0:0", ">=", "TOD#1:0:0", True),
    ("DT#2024-01-01-0:0:0", "<>", "DT#2024-01-01-0:0:0", False), ("T#1s", "<", "T#999ms", False)])
def test_times_and_dates_compare(left, op, right, value):
    assert evaluate("r : BOOL;", f"r := {left} {op} {right};", "r") is value


# ---------------------------------------------------------------- composition


@given(st.dates(datetime.date(1700, 1, 1), datetime.date(2250, 1, 1)), st.times())
@settings(max_examples=60, deadline=None)
def test_dates_are_composed_of_numbers(date, time):
    for name, value in (("y", date.year), ("o", date.month), ("d", date.day), ("h", time.hour),
                        ("i", time.minute), ("s", time.second), ("ms", time.microsecond // 1000)):
        COMPOSED[name] = value
    COMPOSED.scan()
    days = (date - datetime.date(1970, 1, 1)).days * DAY
    clock = ((time.hour * 60 + time.minute) * 60 + time.second) * 10**9 \
        + time.microsecond // 1000 * 10**6
    assert [COMPOSED[k] for k in ("a", "b", "c", "e", "w")] \
        == [days, clock, days + clock, days + clock, date.isoweekday() % 7]


COMPOSED = Controller(main(
    "y : INT; o : USINT; d : UINT; h : INT; i : INT; s : INT; ms : DINT;"
    "a : DATE; b : TOD; c : DT; e : DT; w : INT;",
    "a := CONCAT_DATE(y, o, d); b := CONCAT_TOD(h, i, s, ms); e := CONCAT_DATE_TOD(a, b);"
    "c := CONCAT_DT(YEAR := y, MONTH := o, DAY := d, HOUR := h, MINUTE := i, SECOND := s,"
    "MILLISECOND := ms); w := DAY_OF_WEEK(a);"))


@pytest.mark.parametrize(("call", "reason"), [
    ("CONCAT_DATE(2023, 2, 29)", "no date 2023-2-29"), ("CONCAT_DATE(1500, 1, 1)", "1677"),
    ("DT_TO_DATE(CONCAT_DT(2024, 1, 1, 24, 0, 0, 0))", "no time of day 24:00:00")])
def test_what_is_no_date_is_a_fault(call, reason):
    plc = Controller(main("r : DATE;", f"r := {call};")).scan()
    assert reason in str(plc.resource.fault)


def test_times_and_dates_in_instruction_list():
    assert evaluate("r : TIME;", "LD T#1s\nMUL 2.5\nST r", "r") == 2_500_000_000
    assert evaluate("r : TIME;", "LD D#1970-01-03\nSUB D#1970-01-01\nST r", "r") == 2 * DAY
    assert evaluate("r : TOD;", "LD TOD#23:0:0\nADD T#2h\nST r", "r") == 3600 * 10**9


# ---------------------------------------------------------------- decomposition

PARTS = Controller(main(
    "m : DT; y : INT; o : USINT; d : UINT; h : INT; i : INT; s : SINT; ms : DINT;"
    "y2 : INT; i2 : INT; done : BOOL;",
    "SPLIT_DT(IN := m, YEAR => y, MONTH => o, DAY => d, HOUR => h, MINUTE => i, SECOND => s,"
    "MILLISECOND => ms); SPLIT_DATE(DT_TO_DATE(m), y2, o, d);"
    "SPLIT_TOD(IN := DT_TO_TOD(m), MINUTE => i2, ENO => done);"))


@given(st.datetimes(datetime.datetime(1700, 1, 1), datetime.datetime(2250, 1, 1)))
@settings(max_examples=60, deadline=None)
def test_a_date_and_time_is_split_into_numbers(then):
    PARTS["m"] = (then - datetime.datetime(1970, 1, 1)) // datetime.timedelta(microseconds=1) * 1000
    PARTS.scan()
    assert [PARTS[k] for k in ("y", "o", "d", "h", "i", "s", "ms", "y2", "i2", "done")] \
        == [then.year, then.month, then.day, then.hour, then.minute, then.second,
            then.microsecond // 1000, then.year, then.minute, True]


@pytest.mark.parametrize(("call", "code"), [
    ("SPLIT_DATE(d, y, y, y, y);", "P0026"), ("SPLIT_DATE(YEAR => y);", "P0026"),
    ("SPLIT_DATE(IN := d, HOUR => y);", "P0026"), ("SPLIT_DATE(IN := y, DAY => y);", "P0023"),
    ("SPLIT_DATE(IN := d, DAY => 5);", "P0024"), ("y := SPLIT_DATE(d);", "P0023"),
    ("SPLIT_DATE();", "P0026"), ("SPLIT_DATE(IN := d, DAY => z);", "P0020")])
def test_a_wrong_split_is_reported(call, code):
    assert [f[-5:] for f in findings(main("d : DATE; y : INT;", call))] == [code]


@pytest.mark.parametrize(("text", "ns"), [
    ("T#1s * 2", 2 * 10**9), ("T#1s * 2.5", 2_500_000_000), ("T#1s / 3", 333_333_333),
    ("T#1s + T#1ms * 2", 1_002_000_000), ("T#1s * (1 + 1)", 2 * 10**9)])
def test_a_constant_time_is_scaled_before_the_program_runs(text, ns):
    assert evaluate(f"r : TIME := {text};", "r := r;", "r") == ns


@pytest.mark.parametrize("text", ["2 + 3", "T#1s + 5", "T#1s * T#1s", "D#2024-01-01"])
def test_a_constant_that_is_no_time_is_reported(text):
    assert [f[-5:] for f in findings(main(f"r : TIME := {text};", "r := r;"))] == ["P0023"]
