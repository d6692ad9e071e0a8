"""The file of the historian: an SQLite database of runs, their tags and their frames.

A frame is one row, so a committed frame is whole. Each run begins with a frame that holds every
tag; when old frames are forgotten, the values that they left behind become the new first frame.
Reading needs nothing but SQLite, and may go on while a PLC writes (write-ahead log).
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from plcemu.base.errors import PlcemuError, TraceFormatError
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.base.types import Value

VERSION = 1
"""The version of the schema, in SQLite's `user_version`."""

APPLICATION_ID = 0x504C4348
"""Tells these files from other SQLite databases, in SQLite's `application_id` ("PLCH")."""

BUSY_S = 5.0
"""How long to wait for another process that writes, in s."""

SCHEMA = """
CREATE TABLE run (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL,
    began TEXT NOT NULL,    -- date and time, UTC
    ended TEXT NOT NULL,    -- of the last commit
    end_ns INTEGER NOT NULL -- in the PLC's time
);
CREATE TABLE tag (
    run INTEGER NOT NULL REFERENCES run(id) ON DELETE CASCADE, place INTEGER NOT NULL,
    name TEXT NOT NULL, type TEXT NOT NULL, unit TEXT NOT NULL, address TEXT NOT NULL,
    comment TEXT NOT NULL, "values" TEXT NOT NULL, PRIMARY KEY (run, place)
) WITHOUT ROWID;
CREATE TABLE frame (
    id INTEGER PRIMARY KEY,
    run INTEGER NOT NULL REFERENCES run(id) ON DELETE CASCADE,
    t_ns INTEGER NOT NULL, scan INTEGER NOT NULL,
    changes TEXT NOT NULL   -- JSON: [[place of a tag, value], ...]; null is not known
);
CREATE INDEX frame_time ON frame (run, t_ns);
"""


@dataclass(frozen=True, slots=True)
class Run:
    """One run in the file.

    Attributes:
        id: its number.
        name: of the PLC.
        began: date and time, UTC.
        ended: of the last commit.
        begin_ns: the first instant kept, in the PLC's time.
        end_ns: the last one.
        frames: how many are kept.
    """

    id: int
    name: str
    began: str
    ended: str
    begin_ns: int
    end_ns: int
    frames: int


def connect(path: Path, write: bool = False) -> sqlite3.Connection:
    """Open a historian's file, with `write` also a new one.

    Raises:
        PlcemuError: it is no historian's file, of another version, or cannot be opened.
    """
    try:
        if write:
            base = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None,
                                   check_same_thread=False)
        else:
            base = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=BUSY_S,
                                   isolation_level=None)
        try:
            _prepare(path, base, write)
        except BaseException:
            base.close()
            raise
    except sqlite3.Error as problem:
        raise TraceFormatError(f"{path}: cannot be read as a historian's file: {problem}") from None
    return base


def _prepare(path: Path, base: sqlite3.Connection, write: bool) -> None:
    empty = _is_empty(base)
    if empty and not write:
        return  # made, and not begun: its maker may have been killed at that instant
    if write:
        if empty:
            base.execute("PRAGMA auto_vacuum = INCREMENTAL")
        base.execute("PRAGMA journal_mode = WAL")
        base.execute("PRAGMA synchronous = NORMAL")
        base.execute("PRAGMA foreign_keys = ON")
        base.execute("PRAGMA journal_size_limit = 4000000")
        if empty:
            base.executescript(f"BEGIN; PRAGMA application_id = {APPLICATION_ID}; "
                               f"PRAGMA user_version = {VERSION}; {SCHEMA} COMMIT;")
    (application,), (version,) = (base.execute(f"PRAGMA {what}").fetchone()
                                  for what in ("application_id", "user_version"))
    if application != APPLICATION_ID or version != VERSION:
        raise PlcemuError(f"{path}: found a database of another kind or version, expected a "
                          f"historian's file of version {VERSION}")


def _is_empty(base: sqlite3.Connection) -> bool:
    return not base.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]


def add_run(base: sqlite3.Connection, name: str, now: str, tags: Sequence[Tag]) -> int:
    """Insert a run with its tags and return its number."""
    run = base.execute("INSERT INTO run (name, began, ended, end_ns) VALUES (?, ?, ?, 0)",
                       (name, now, now)).lastrowid
    assert run is not None
    base.executemany("INSERT INTO tag VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                     [(run, i, tag.name, tag.type, tag.unit, tag.address, tag.comment,
                       json.dumps(tag.values)) for i, tag in enumerate(tags)])
    return run


def add_frames(base: sqlite3.Connection, run: int, frames: Sequence[Frame]) -> None:
    """Insert frames."""
    base.executemany("INSERT INTO frame (run, t_ns, scan, changes) VALUES (?, ?, ?, ?)",
                     [(run, f.t_ns, f.scan, json.dumps(f.changes)) for f in frames])


def forget_before(base: sqlite3.Connection, run: int, t_ns: int) -> int:
    """Forget a run's frames before an instant; their last values become its first frame.

    Returns:
        How many frames fewer there are.
    """
    old = base.execute("SELECT id, t_ns, scan, changes FROM frame WHERE run = ? AND t_ns <= ? "
                       "ORDER BY id", (run, t_ns)).fetchall()
    if len(old) < 2:
        return 0
    values: dict[int, Value | None] = {}
    for *_, changes in old:
        values.update(json.loads(changes))
    last, at_ns, scan, _ = old[-1]
    base.execute("DELETE FROM frame WHERE run = ? AND id < ?", (run, last))
    base.execute("UPDATE frame SET t_ns = ?, scan = ?, changes = ? WHERE id = ?",
                 (at_ns, scan, json.dumps(sorted(values.items())), last))
    return len(old) - 1


def runs(path: Path) -> list[Run]:
    """Return the runs in a file, oldest first.

    Raises:
        PlcemuError: it is no historian's file.
    """
    with closing(connect(path)) as base:
        return _runs(base)


def _runs(base: sqlite3.Connection) -> list[Run]:
    if _is_empty(base):
        return []
    rows = base.execute(
        "SELECT run.id, name, began, ended, coalesce(min(frame.t_ns), 0), end_ns, count(frame.id) "
        "FROM run LEFT JOIN frame ON frame.run = run.id GROUP BY run.id ORDER BY run.id")
    return [Run(*row) for row in rows]


def read(path: Path, run: int | None = None, begin_ns: int = 0, end_ns: int | None = None,
         names: Sequence[str] = ()) -> Trace:
    """Read a run as a trace.

    Args:
        path: the file.
        run: its number; by default the last one.
        begin_ns: the trace's first frame holds the values of this instant.
        end_ns: where the trace is cut; by default at its end.
        names: of the tags; by default all.

    Raises:
        PlcemuError: it is no historian's file, or there is no such run.
        UnknownNameError: there is no such tag.
    """
    with closing(connect(path)) as base:
        base.execute("BEGIN")  # one state of the file, whoever writes meanwhile
        known = _runs(base)
        if not known:
            raise PlcemuError(f"{path}: holds no run")
        found = next((r for r in known if run in (None, r.id)), None) if run is not None \
            else known[-1]
        if found is None:
            raise PlcemuError(f"{path}: there is no run {run}; there is "
                              f"{', '.join(str(r.id) for r in known)}")
        tags = _tags(base, found.id)
        chosen = [tags.find(name) for name in names] or list(range(len(tags)))
        chosen = list(dict.fromkeys(chosen))
        trace = Trace(TagTable(tags[i] for i in chosen))
        places = {old: new for new, old in enumerate(chosen)}
        last_ns = found.end_ns if end_ns is None else min(end_ns, found.end_ns)
        for frame in _cut(_frames(base, found.id, last_ns), begin_ns):
            trace.observe(Frame(frame.t_ns, frame.scan, tuple(sorted(
                (places[i], value) for i, value in frame.changes if i in places))))
        trace.end_ns = max(trace.end_ns, last_ns)
        return trace


def _tags(base: sqlite3.Connection, run: int) -> TagTable:
    rows = base.execute('SELECT name, type, unit, address, comment, "values" FROM tag '
                        "WHERE run = ? ORDER BY place", (run,))
    return TagTable(Tag(name, kind, unit, address, comment,
                        tuple((n, v) for n, v in json.loads(values)))
                    for name, kind, unit, address, comment, values in rows)


def _frames(base: sqlite3.Connection, run: int, end_ns: int) -> Iterator[Frame]:
    for t_ns, scan, changes in base.execute(
            "SELECT t_ns, scan, changes FROM frame WHERE run = ? AND t_ns <= ? ORDER BY id",
            (run, end_ns)):
        yield Frame(t_ns, scan, tuple((i, v) for i, v in json.loads(changes)))


def _cut(frames: Iterator[Frame], begin_ns: int) -> Iterator[Frame]:
    """Join the frames up to an instant into one at it."""
    values: dict[int, Value | None] = {}
    scan = 0
    for frame in frames:
        if frame.t_ns <= begin_ns:
            values.update(frame.changes)
            scan = frame.scan
            continue
        if values:
            yield Frame(begin_ns, scan, tuple(sorted(values.items())))
            values = {}
        yield frame
    if values:
        yield Frame(begin_ns, scan, tuple(sorted(values.items())))
