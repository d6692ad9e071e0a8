"""Traces survive being written to a file and read back."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plcemu.base.errors import PlcemuError, TraceFormatError
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.base.tracefile import load, save
from plcemu.base.types import Value

TAGS = (Tag("MAIN.pump", "BOOL", "", "%QX0.0"), Tag("plant.B1.level", "LREAL", "l"),
        Tag("MAIN.count", "LINT"), Tag("MAIN.state", "STRING"), Tag("total", "ULINT"))
WIDE = 2 ** 40

texts = st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), max_size=8)
rows = st.tuples(st.booleans(), st.floats(allow_nan=False, allow_infinity=False),
                 st.integers(-2 ** 63, 2 ** 63 - 1), texts, st.integers(0, 2 ** 64 - 1))
moments = st.lists(st.tuples(st.integers(1, WIDE), rows), min_size=1, max_size=6)


def trace_of(parts: list[tuple[int, tuple[Value, ...]]], rest_ns: int = 0) -> Trace:
    """Return a trace of rows, each a while after the one before."""
    trace = Trace(TagTable(TAGS))
    t_ns, last = 0, (None,) * len(TAGS)
    for later_ns, row in parts:
        t_ns += later_ns
        changes = tuple((i, v) for i, (v, w) in enumerate(zip(row, last, strict=True)) if v != w)
        trace.observe(Frame(t_ns, len(trace.frames), changes))
        last = row
    trace.end_ns += rest_ns
    return trace


def story(trace: Trace) -> tuple[int, dict[str, list[tuple[int, Value]]]]:
    """Return the end and the changes of each tag."""
    return trace.end_ns, {tag.name: trace.history(tag.name) for tag in trace.tags}


SAMPLE = trace_of([(5, (True, 0.1, -1, "FILL", 7)), (10, (False, 1 / 3, -1, "it's\ta \\", 7))], 85)


@pytest.mark.parametrize("ending", [".csv", ".jsonl", ".vcd"])
@settings(deadline=None)
@given(parts=moments, rest_ns=st.integers(0, WIDE))
def test_a_trace_reads_back_with_the_same_changes_and_the_same_end(
        tmp_path_factory: pytest.TempPathFactory, ending: str,
        parts: list[tuple[int, tuple[Value, ...]]], rest_ns: int) -> None:
    # Texts that look like numbers do not survive .csv, which has no types.
    kept = [(t, (*row[:3], f"[{row[3]}", row[4])) for t, row in parts]
    trace = trace_of(kept, rest_ns)
    path = tmp_path_factory.mktemp("trace") / f"run{ending}"
    save(trace, path)
    assert story(load(path)) == story(trace)


def test_a_csv_file_has_one_row_for_each_change_and_one_for_the_end(tmp_path: Path) -> None:
    save(SAMPLE, tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text(encoding="utf-8") == (
        "t_ns,MAIN.pump,plant.B1.level,MAIN.count,MAIN.state,total\n"
        "5,1,0.1,-1,FILL,7\n"
        "15,0,0.3333333333333333,-1,it's\ta \\,7\n"
        "100,0,0.3333333333333333,-1,it's\ta \\,7\n")


def test_a_jsonl_file_keeps_types_units_addresses_and_scans(tmp_path: Path) -> None:
    save(SAMPLE, tmp_path / "run.jsonl")
    trace = load(tmp_path / "run.jsonl")
    assert tuple(trace.tags) == TAGS
    assert trace.frames == SAMPLE.frames


@pytest.mark.parametrize("ending", [".csv", ".jsonl", ".vcd"])
def test_the_same_run_is_the_same_file(tmp_path: Path, ending: str) -> None:
    paths = [tmp_path / f"{name}{ending}" for name in "ab"]
    [save(SAMPLE, path) for path in paths]
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_vcd_file_has_a_scope_for_each_dot_and_no_date(tmp_path: Path) -> None:
    save(SAMPLE, tmp_path / "run.vcd")
    text = (tmp_path / "run.vcd").read_text(encoding="utf-8")
    assert "$timescale 1 ns $end" in text
    assert "$scope module plant $end\n$scope module B1 $end\n$var real 64" in text
    assert "$date" not in text
    assert text.endswith("#100\n")


def test_the_types_of_csv_columns_are_guessed_from_their_values(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t_ns,b,i,r,s,e\n0,0,2,2,x,\n5,1,0,0.5,1,3\n")
    trace = load(tmp_path / "run.csv")
    assert [tag.type for tag in trace.tags] == ["BOOL", "LINT", "LREAL", "STRING", "LINT"]
    assert trace.history("e") == [(5, 3)]
    assert trace.history("b") == [(0, False), (5, True)]


def test_a_vcd_file_in_picoseconds_is_read_in_ns(tmp_path: Path) -> None:
    (tmp_path / "run.vcd").write_text(
        "$timescale 100 ps $end $scope module top $end $var wire 1 ! x $end $upscope $end "
        "$enddefinitions $end\n#0\nx!\n#20\n1!\n#50\n")
    trace = load(tmp_path / "run.vcd")
    assert trace.history("top.x") == [(2, True)]
    assert trace.end_ns == 5


def test_not_a_number_survives_every_format(tmp_path: Path) -> None:
    trace = Trace(TagTable([Tag("p.x", "LREAL")]), [Frame(0, 0, ((0, math.nan),))])
    for ending in (".csv", ".jsonl", ".vcd"):
        save(trace, tmp_path / f"run{ending}")
        assert math.isnan(float(load(tmp_path / f"run{ending}").history("p.x")[0][1]))


def test_an_unknown_ending_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(PlcemuError, match=r"'\.xls', expected one of \.csv, \.jsonl, \.vcd"):
        save(SAMPLE, tmp_path / "run.xls")


@pytest.mark.parametrize(("name", "content", "message"), [
    ("x.csv", "time,a\n", ":1: found 'time,a', expected the header t_ns,tag,tag,..."),
    ("x.csv", "", ":1: found '', expected the header t_ns,tag,tag,..."),
    ("x.csv", "t_ns,a\n0,1\n1\n", ":3: found 1 columns, expected 2"),
    ("x.csv", "t_ns,a\n0,1\nsoon,1\n", ":3: found 'soon', expected a whole number of ns"),
    ("x.csv", "t_ns,a\n5,1\n5,0\n", ":3: found t_ns 5, expected an instant after 5"),
    ("x.csv", "t_ns,a,A\n5,1,1\n", ":1: found there are two tags 'A', expected each tag once"),
    ("x.jsonl", "", ':1: found nothing, expected an object with "tags"'),
    ("x.jsonl", "[1]\n", ":1: found [1], expected a JSON object"),
    ("x.jsonl", "{\n", ":1: found no JSON"),
    ("x.jsonl", '{"tags": [{"name": "a"}]}\n', ":1: found {'name': 'a'}, expected a tag with"),
    ("x.jsonl", '{"tags": []}\n{"t_ns": 0, "scan": 0, "changes": {"b": true}}\n',
     ":2: found the tag 'b', expected one of the tags of line 1"),
    ("x.jsonl", '{"tags": []}\n{"t_ns": "0"}\n', ":2: found t_ns '0', expected a whole number"),
    ("x.vcd", "$scope module a $end\n#0\n#5\n", ":3: found the instant 0 ns, expected $end"),
    ("x.vcd", "$enddefinitions $end\n#0\n1!\n", ":3: found the code '!', expected one that"),
    ("x.vcd", "$enddefinitions $end\n#5\n#3\n", ":3: found the instant 3 ns, expected one from 5"),
    ("x.vcd", "hello", ":1: found"),
])
def test_a_malformed_file_is_told_with_its_line(
        tmp_path: Path, name: str, content: str, message: str) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(TraceFormatError) as caught:
        load(tmp_path / name)
    assert str(tmp_path / name) + message in str(caught.value)
