"""Literals of strings, dates and times (IEC 61131-3, 2.2, tables 4 to 8)."""

import datetime

import pytest
from controller import evaluate, findings, main
from hypothesis import given, settings
from hypothesis import strategies as st

DAY_NS = 86_400 * 10**9


@pytest.mark.parametrize(("text", "value"), [
    ("'abc'", "abc"), ("''", ""), ("'$$'", "$"), ("'$''", "'"), ("'$\"'", None), ("'\"'", '"'),
    ("'$L$l$N$n$R$r'", "\n\n\n\n\r\r"), ("'$P$T$p$t'", "\f\t\f\t"), ("'$41$e9'", "A\xe9"),
    ("'$4$41'", None), ("'a$'", None), ("'a$", None), ("STRING#'x$$'", "x$"),
    ("string#'x'", "x"), ("STRING#\"x\"", None), ("'$Q'", None), ("'$G1'", None),
])
def test_a_string_literal_with_escapes(text, value):
    program = main("r : STRING;", f"r := {text};")
    found = findings(program)
    assert found == [] if value is not None else found[0].endswith(("P0003", "P0002"))
    assert value is None or evaluate("r : STRING;", f"r := {text};", "r") == value


@pytest.mark.parametrize(("text", "value"), [
    ('"abc"', "abc"), ('"$""', '"'), ('"\'"', "'"), ('"$0041$20AC"', "A\u20ac"),
    ('"$D83D$DE00"', "\U0001f600"), ('WSTRING#"x"', "x"), ('"\U0001f600"', "\U0001f600"),
])
def test_a_wstring_literal_with_escapes(text, value):
    assert evaluate("r : WSTRING;", f"r := {text};", "r") == value


@pytest.mark.parametrize(("text", "found"), [
    ("r := 'ab$zc';", ["5:9: P0003"]), ("r := '$1';", ["5:7: P0003"]),
    ("r := STRING#'ab$z';", ["5:16: P0003"]),
])
def test_a_bad_escape_is_reported_at_its_place(text, found):
    assert findings(main("r : STRING;", text)) == found


@pytest.mark.parametrize("text", ['"$D83D"', '"$41"', '"$zzzz"', "WSTRING#'x'"])
def test_what_is_no_wstring_is_reported(text):
    assert findings(main("r : WSTRING;", f"r := {text};"))[0].endswith("P0003")


def test_a_character_that_string_does_not_hold_is_reported():
    assert findings(main("r : STRING;", "r := '\u20ac';")) == ["5:6: P0025"]


@given(st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), max_size=20))
@settings(max_examples=60, deadline=None)
def test_any_wstring_can_be_written_in_hexadecimal(text):
    literal = '"' + "".join(f"${ord(c):04X}" for c in text) + '"'
    assert evaluate("r : WSTRING;", f"r := {literal};", "r") == text


# ---------------------------------------------------------------- dates


@pytest.mark.parametrize("prefix", ["D", "DATE", "d", "Date", "LD", "LDATE"])
def test_a_date_counts_from_1970(prefix):
    days = (datetime.date(2024, 2, 29) - datetime.date(1970, 1, 1)).days
    assert evaluate("r : DATE;", f"r := {prefix}#2024-02-29;", "r") == days * DAY_NS


@pytest.mark.parametrize("prefix", ["TOD", "TIME_OF_DAY", "tod", "LTOD"])
def test_a_time_of_day_counts_from_midnight(prefix):
    assert evaluate("r : TIME_OF_DAY;", f"r := {prefix}#15:36:55.36;", "r") \
        == ((15 * 60 + 36) * 60 + 55) * 10**9 + 360_000_000


@pytest.mark.parametrize("prefix", ["DT", "DATE_AND_TIME", "dt", "LDT"])
def test_a_date_and_time_is_both(prefix):
    then = datetime.datetime(1984, 6, 25, 15, 36, 55) - datetime.datetime(1970, 1, 1)
    assert evaluate("r : DT;", f"r := {prefix}#1984-06-25-15:36:55.360000001;", "r") \
        == (then.days * 86_400 + then.seconds) * 10**9 + 360_000_001


@pytest.mark.parametrize("text", [
    "D#2023-02-29", "D#2024-13-01", "D#2024-00-01", "D#2024-1", "D#1600-01-01", "D#2300-01-01",
    "D#x", "TOD#24:00:00", "TOD#1:60:0", "TOD#1:2:60", "TOD#1:2", "TOD#1:2:3.1234567891",
    "DT#2024-02-30-1:2:3", "DT#2024-02-29", "DT#2024-02-29-25:0:0", "T#abc", "T#5", "TIME#5",
    "DATE#x", "INT#abc", "REAL#abc", "BOOL#2", "SINT#128", "USINT#-1", "BYTE#16#100",
])
def test_what_is_no_literal_of_its_type_is_reported_once_at_its_place(text):
    assert findings(main("r : BOOL;", f"r := {text};")) == ["5:6: P0003"]


@pytest.mark.parametrize(("of", "text", "value"), [
    ("INT", "INT#-5", -5), ("INT", "INT#+5", 5), ("BOOL", "BOOL#1", True),
    ("BOOL", "bool#false", False), ("REAL", "REAL#5", 5.0), ("REAL", "REAL#-1.5e1", -15.0),
    ("LREAL", "1E5", 1e5), ("LREAL", "1e-2", 0.01), ("LREAL", "1.5E+3", 1500.0),
    ("WORD", "WORD#16#FF", 255), ("UINT", "UINT#2#1010_1010", 170), ("TIME", "T#-5s", -5 * 10**9),
    ("TIME", "T#1d_2h", 26 * 3600 * 10**9), ("TIME", "time#1.5m", 90 * 10**9),
    ("LTIME", "LTIME#5us6ns", 5006), ("LTIME", "LT#1ns", 1),
])
def test_typed_literals(of, text, value):
    assert evaluate(f"r : {of};", f"r := {text};", "r") == value


def test_a_time_that_64_bits_do_not_hold_is_reported():
    assert findings(main("r : TIME;", "r := T#106752d;")) == ["5:6: P0025"]


def test_the_values_of_an_enumeration_keep_their_typed_names():
    text = "TYPE Color : (RED, GREEN); END_TYPE\n" + main(
        "r : Color; x : BOOL;", "r := Color#GREEN; x := r = Color#GREEN;")
    assert findings(text) == []


def test_dates_and_strings_are_initial_values_and_constants():
    assert evaluate("d : DATE := D#1970-01-02; s : STRING[5] := 'a$Lb'; r : BOOL;",
                    "r := d = D#1970-01-02 AND s = 'a$0Ab';", "r")


def test_dates_and_strings_are_operands_in_instruction_list():
    assert evaluate("d : DATE := D#1970-01-02; r : BOOL;", "LD d\nEQ D#1970-01-02\nST r", "r")
    assert evaluate("s : STRING; r : BOOL;", "LD 'abc'\nST s\nLD s\nEQ 'abc'\nST r", "r")
