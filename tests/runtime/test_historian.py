"""The historian: what is committed reads back, its bounds hold, its losses are counted."""

import sqlite3
import threading
from contextlib import closing

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plcemu
from plcemu.base import historyfile
from plcemu.base.errors import PlcemuError, UnknownNameError
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.base.tracefile import load
from plcemu.runtime.historian import Historian, Keep, Ring

S = 1_000_000_000
TAGS = TagTable([Tag("MAIN.pump", "BOOL", "", "%QX0.0", "the pump"),
                 Tag("plant.level", "LREAL", "l"),
                 Tag("MAIN.mode", "INT", values=(("off", 0), ("auto", 1))), Tag("note", "STRING")])


def frames(count, step_ns=S):
    yield Frame(0, 0, ((0, False), (1, 0.0), (2, 0), (3, "")))
    for n in range(1, count):
        yield Frame(n * step_ns, n, ((0, bool(n % 2)), (1, n / 3)))


def record(path, rows, tags=TAGS, **options):
    historian = Historian(path, "tank", lambda: tags, **options)
    for frame in rows:
        historian.observe(frame)
    historian.close()
    return historian.counters


def test_a_run_reads_back_with_its_tags_and_frames(tmp_path):
    path = tmp_path / "h.sqlite"
    counters = record(path, frames(50))
    trace = load(path)
    assert list(trace.tags) == list(TAGS)
    assert trace.frames == list(frames(50))
    assert (counters.frames, counters.lost, counters.error, trace.end_ns) == (50, 0, "", 49 * S)


def test_each_start_is_a_run_of_its_own(tmp_path):
    path = tmp_path / "h.sqlite"
    record(path, frames(5))
    record(path, frames(9))
    assert [(r.id, r.name, r.frames, r.end_ns) for r in historyfile.runs(path)] == [
        (1, "tank", 5, 4 * S), (2, "tank", 9, 8 * S)]
    assert len(historyfile.read(path, run=1).frames) == 5
    with pytest.raises(PlcemuError, match=r"there is no run 3; there is 1, 2"):
        historyfile.read(path, run=3)


def test_only_chosen_tags_are_recorded(tmp_path):
    path = tmp_path / "h.sqlite"
    record(path, frames(5), chosen=["plant.*", "main.MODE"])
    trace = load(path)
    assert [tag.name for tag in trace.tags] == ["plant.level", "MAIN.mode"]
    assert trace.history("plant.level") == [(n * S, n / 3) for n in range(5)]


def test_another_tag_table_begins_another_run(tmp_path):
    path = tmp_path / "h.sqlite"
    tables = [TAGS]
    historian = Historian(path, "tank", lambda: tables[-1])
    for frame in frames(3):
        historian.observe(frame)
    tables.append(TagTable([Tag("MAIN.new", "INT")]))
    historian.observe(Frame(3 * S, 3, ((0, 7),)))
    historian.close()
    assert [run.frames for run in historyfile.runs(path)] == [3, 1]
    assert load(path).history("MAIN.new") == [(3 * S, 7)]


@settings(max_examples=25, deadline=None)
@given(begin=st.integers(0, 22), length=st.integers(0, 22))
def test_a_stretch_begins_with_the_values_that_held_there(tmp_path_factory, begin, length):
    path = tmp_path_factory.mktemp("h") / "h.sqlite"
    record(path, frames(20))
    cut = historyfile.read(path, begin_ns=begin * S, end_ns=(begin + length) * S,
                           names=["level", "pump"])
    known = {t: dict(state) for t, state in load(path).values()}
    for t_ns, state in cut.values():
        held = known[max(t for t in known if t <= t_ns)]
        assert (state[0], state[1]) == (held[1], held[0])
    assert all(begin * S <= frame.t_ns <= (begin + length) * S or frame is cut.frames[0]
               for frame in cut.frames)


def test_what_is_older_than_the_age_is_forgotten_and_its_values_stay(tmp_path):
    path = tmp_path / "h.sqlite"
    counters = record(path, frames(100), keep=Keep(age_ns=10 * S))
    trace = load(path)
    assert (trace.frames[0].t_ns, len(trace.frames)) == (89 * S, 11)
    assert dict(trace.frames[0].changes) == {0: True, 1: 89 / 3, 2: 0, 3: ""}
    assert counters.forgotten == 89


def test_old_runs_are_forgotten_by_date(tmp_path):
    path = tmp_path / "h.sqlite"
    record(path, frames(5))
    with closing(historyfile.connect(path, write=True)) as base:
        base.execute("UPDATE run SET ended = '2001-01-01T00:00:00+00:00'")
    record(path, frames(5), keep=Keep(age_ns=3600 * S))
    assert [run.id for run in historyfile.runs(path)] == [2]


def test_the_file_stays_within_its_size(tmp_path):
    path = tmp_path / "h.sqlite"
    size = 200_000
    record(path, frames(2000), keep=Keep(size=size))
    counters = record(path, frames(8000), keep=Keep(size=size))
    trace = load(path)
    assert path.stat().st_size <= size
    assert [run.id for run in historyfile.runs(path)] == [2]
    assert counters.forgotten > 0
    assert dict(trace.frames[0].changes).keys() == {0, 1, 2, 3}
    assert trace.frames[-1] == list(frames(8000))[-1]


def test_frames_without_room_are_counted_and_their_values_come_with_the_next(tmp_path):
    path = tmp_path / "h.sqlite"
    with closing(historyfile.connect(path, write=True)) as other:
        historian = Historian(path, "tank", lambda: TAGS, limit=10, interval_s=3600)
        with historian._queue.change:  # the thread cannot take anything
            rows = list(frames(20))
            for frame in rows[:19]:
                historian.observe(frame)
            historian._queue.items.pop()
            historian.observe(rows[19])
        historian.close()
        other.execute("PRAGMA integrity_check")
    trace = load(path)
    assert historian.counters.lost == 10
    *_, (_, last) = trace.values()
    assert last == {0: True, 1: 19 / 3, 2: 0, 3: ""}


def test_a_disk_that_fails_for_a_while_loses_nothing(tmp_path):
    path = tmp_path / "h.sqlite"
    historian = Historian(path, "tank", lambda: TAGS, interval_s=0.01)
    failed = threading.Event()
    real, calls = historian._commit, []

    def commit(batch):
        calls.append(len(batch))
        failed.set()
        return real(batch) if len(calls) > 1 else False

    historian._commit = commit
    rows = list(frames(30))
    for frame in rows[:10]:
        historian.observe(frame)
    assert failed.wait(10)
    for frame in rows[10:]:
        historian.observe(frame)
    historian.close()
    assert load(path).frames == rows


def test_the_file_can_be_read_while_it_is_written(tmp_path):
    path = tmp_path / "h.sqlite"
    record(path, frames(5))
    with closing(historyfile.connect(path, write=True)) as base:
        base.execute("BEGIN IMMEDIATE")
        base.execute("INSERT INTO frame (run, t_ns, scan, changes) VALUES (1, 9, 9, '[]')")
        assert len(load(path).frames) == 5
        base.execute("ROLLBACK")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "text.sqlite").write_text("no database, but long enough to be looked at " * 20)
    with pytest.raises(PlcemuError, match="cannot be read as a historian's file"):
        load(tmp_path / "text.sqlite")
    with closing(sqlite3.connect(tmp_path / "other.sqlite")) as base:
        base.execute("CREATE TABLE t (x)")
    for write in (False, True):
        with pytest.raises(PlcemuError, match="another kind or version"):
            historyfile.connect(tmp_path / "other.sqlite", write)
    (tmp_path / "empty.sqlite").touch()
    with pytest.raises(PlcemuError, match="holds no run"):
        load(tmp_path / "empty.sqlite")
    record(tmp_path / "h.sqlite", frames(2))
    with pytest.raises(UnknownNameError):
        historyfile.read(tmp_path / "h.sqlite", names=["pomp"])


def test_a_ring_keeps_the_last_frames_and_what_held_before(tmp_path):
    ring, whole = Ring(lambda: TAGS, 5), Trace(TAGS)
    for frame in frames(40):
        ring.observe(frame)
        whole.observe(frame)
    kept = ring.trace()
    assert [frame.t_ns // S for frame in kept.frames] == [34, 35, 36, 37, 38, 39]
    states = {t: dict(state) for t, state in whole.values()}
    assert all(state == states[t] for t, state in kept.values())


def test_a_plcs_run_is_the_same_in_its_trace_and_in_the_historian(tmp_path):
    plc = plcemu.Plc("PROGRAM MAIN VAR n : INT; half : REAL; END_VAR n := n + 1; "
                     "half := INT_TO_REAL(n) / 3.0; END_PROGRAM", record=True)
    historian = Historian(tmp_path / "h.sqlite", "x", lambda: plc.tags)
    plc.cycle.observers.append(historian)
    plc.scan(50)
    historian.close()
    assert load(tmp_path / "h.sqlite").frames == plc.trace.frames
