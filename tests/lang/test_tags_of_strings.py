"""Tags of strings, dates and enumerations: from Python, by force and in trace files."""

import pytest
from controller import main

from plcemu.base.tracefile import load, save
from plcemu.runtime.access import ValueTypeError
from plcemu.runtime.plc import Plc

TEXT = "TYPE Color : (RED, GREEN, BLUE); END_TYPE\n" + main(
    "name : STRING[5]; wide : WSTRING[4]; n : INT; d : DATE; c : Color; t : TOD; m : DT;"
    "row : ARRAY[1..2] OF STRING[3];",
    "n := LEN(name); d := D#1970-01-02; c := GREEN; t := TOD#1:0:0; m := DT#1970-01-02-0:0:1;"
    "row[2] := name;")


def test_a_string_tag_is_written_and_read():
    plc = Plc(TEXT)
    plc["name"], plc["wide"] = "abc", "\u20ac\U0001f600"
    plc.scan()
    assert (plc["name"], plc["wide"], plc["n"], plc["row[2]"]) \
        == ("abc", "\u20ac\U0001f600", 3, "abc")
    plc["name"] = ""
    plc.scan()
    assert (plc["name"], plc["n"]) == ("", 0)


def test_dates_and_enumerations_read_as_numbers():
    plc = Plc(TEXT)
    plc.scan()
    assert (plc["d"], plc["c"], plc["t"], plc["m"]) \
        == (86_400 * 10**9, 1, 3600 * 10**9, 86_401 * 10**9)


@pytest.mark.parametrize(("name", "value", "reason"), [
    ("name", "abcdef", "longer than 5 characters"), ("name", 5, "no value|not a value"),
    ("name", "\u20ac", "does not hold"), ("wide", "abc\U0001f600", "longer than 4 characters"),
    ("n", "abc", "not a value of type INT"), ("d", "abc", "not a value of type DATE"),
])
def test_a_value_that_does_not_fit_a_tag_is_an_error_with_its_name(name, value, reason):
    with pytest.raises(ValueTypeError, match=f"{name}: .*({reason})"):
        Plc(TEXT)[name] = value


def test_a_forced_string_stays():
    plc = Plc(TEXT)
    plc.force("name", "xy")
    plc["name"] = "abc"
    plc.scan(2)
    assert (plc["name"], plc["n"]) == ("xy", 2)


@pytest.mark.parametrize("ending", ["csv", "jsonl", "vcd"])
def test_strings_and_dates_go_through_trace_files(tmp_path, ending):
    plc = Plc(TEXT, record=True)
    for value in ("a", "b,\"\n", "\xe9 x"):
        plc["name"] = value
        plc.scan()
    save(plc.trace, tmp_path / f"t.{ending}")
    trace = load(tmp_path / f"t.{ending}")
    name = trace.tags.find("name")
    seen = [value for frame in trace.frames for i, value in frame.changes if i == name and value]
    assert seen == ["a", "b,\"\n", "\xe9 x"]
