"""Traces as files: `.csv` for spreadsheets, `.jsonl` for programs, `.vcd` for wave viewers.

One row of `FORMATS` a format. What a format cannot hold is guessed on reading: `.csv` has no
types, so that a tag of nothing but 0 and 1 reads back as BOOL, whole numbers as LINT, numbers as
LREAL and anything else as STRING. An empty field is a value that is not known (null in `.jsonl`,
`x` in `.vcd`), but in a column of texts an empty text. Neither `.csv` nor `.vcd` has scan numbers,
so frames are numbered from 0. No format holds the date: the same run is the same file, byte for
byte.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from plcemu.base.errors import PlcemuError, TraceFormatError
from plcemu.base.foreign import Reading, Table, read_table, renamed
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.base.types import Value


@dataclass(frozen=True, slots=True)
class Format:
    """How one file format is written and read."""

    write: Callable[[Trace, TextIO], None]
    read: Callable[[Path], Trace]


HISTORY_ENDING = ".sqlite"
"""What the names of the historian's files end in (`plcemu.base.historyfile`)."""


def save(trace: Trace, path: str | Path) -> None:
    """Write a trace; the ending of the name says how.

    Raises:
        PlcemuError: the ending is unknown.
        OSError: the file cannot be written.
    """
    form = _format_of(Path(path))
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        form.write(trace, file)


def load(path: str | Path, reading: Reading = Reading()) -> Trace:  # noqa: B008
    """Read a trace; the ending of the name says how. A historian's file ends in `.sqlite`.

    Args:
        path: the file.
        reading: how a file of another tool is read.

    Raises:
        PlcemuError: the ending is unknown.
        TraceFormatError: the file is malformed.
        OSError: the file cannot be read.
    """
    path = Path(path)
    try:
        return renamed(_read(path, reading), reading.names)
    except UnicodeDecodeError as error:
        raise wrong(path, 1, f"bytes that are no UTF-8 ({error.reason})", "text") from None
    except csv.Error as error:
        raise wrong(path, 1, f"no table ({error})", "values and commas") from None


def _read(path: Path, reading: Reading) -> Trace:
    if path.suffix.lower() == HISTORY_ENDING:
        # SQLite is wanted only by those who read such a file.
        from plcemu.base import historyfile

        return historyfile.read(path, reading.run)
    form = _format_of(path)
    if path.suffix.lower() == ".csv" and (reading.time, reading.unit, reading.delimiter) != \
            (None, None, None):
        return _of_table(path, read_table(path, reading))
    return form.read(path)


def wrong(path: Path, line: int, found: str, expected: str) -> TraceFormatError:
    """Return the error that says what stands in a line and what should."""
    return TraceFormatError(f"{path}:{line}: found {found}, expected {expected}")


def _format_of(path: Path) -> Format:
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise PlcemuError(f"{path}: found {f'the ending {ending!r}' if ending else 'no ending'}, "
                          f"expected one of {', '.join(FORMATS)}, or {HISTORY_ENDING}")
    return FORMATS[ending]


# .csv: a row for each instant at which something changed, and one for the end.

_TRUTH = {False: "0", True: "1"}


def _text(value: Value | None) -> str:
    if isinstance(value, bool):
        return _TRUTH[value]
    return "" if value is None else value if isinstance(value, str) else repr(value)


def _write_csv(trace: Trace, file: TextIO) -> None:
    out = csv.writer(file, lineterminator="\n")
    out.writerow(["t_ns", *(tag.name for tag in trace.tags)])
    row = [""] * len(trace.tags)
    for frame in trace.frames:
        for index, value in frame.changes:
            row[index] = _text(value)
        out.writerow([frame.t_ns, *row])
    if trace.frames and trace.end_ns > trace.frames[-1].t_ns:
        out.writerow([trace.end_ns, *row])


def _read_csv(path: Path) -> Trace:
    times: list[int] = []
    rows: list[list[str]] = []
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines = csv.reader(file)
        header = next(lines, [])
        if not header or header[0].strip() != "t_ns":
            return _of_table(path, read_table(path, Reading()))
        for row in lines:
            if not row:
                continue
            if len(row) != len(header):
                raise wrong(path, lines.line_num, f"{len(row)} columns", f"{len(header)}")
            times.append(_instant(path, lines.line_num, row[0], times))
            rows.append(row[1:])
    columns = [_column([row[i] for row in rows]) for i in range(len(header) - 1)]
    tags = _table(path, [Tag(name.strip(), type_) for name, (type_, _) in
                         zip(header[1:], columns, strict=True)])
    return _trace(tags, zip(times, zip(*(values for _, values in columns), strict=True)
                            if columns else [()] * len(times), strict=True))


def _of_table(path: Path, table: Table) -> Trace:
    """Return the trace in a table of another tool."""
    columns = [_column([row[i] for row in table.rows], _WORDS) for i in range(len(table.names))]
    tags = _table(path, [Tag(name, type_) for name, (type_, _) in
                         zip(table.names, columns, strict=True)])
    return _trace(tags, zip(table.times, zip(*(values for _, values in columns), strict=True)
                            if columns else [()] * len(table.times), strict=True))


def _instant(path: Path, line: int, text: str, before: list[int]) -> int:
    """Read a `t_ns` that must be later than the last one."""
    try:
        t_ns = int(text)
    except ValueError:
        raise wrong(path, line, repr(text), "a whole number of ns") from None
    if t_ns < 0 or (before and t_ns <= before[-1]):
        expected = f"an instant after {before[-1]}" if before else "an instant from 0 on"
        raise wrong(path, line, f"t_ns {t_ns}", expected)
    return t_ns


_READERS: tuple[tuple[str, Callable[[str], Value]], ...] = (
    ("BOOL", lambda text: {"0": False, "1": True}[text]),
    ("LINT", int),
    ("LREAL", float),
    ("STRING", str),
)


_WORDS: tuple[tuple[str, Callable[[str], Value]], ...] = (
    ("BOOL", lambda text: {"0": False, "1": True, "false": False, "true": True}[text.casefold()]),
    *_READERS[1:])
"""Of other tools' tables, in which Booleans may be words."""


def _column(texts: list[str], readers: Sequence[tuple[str, Callable[[str], Value]]] = _READERS
            ) -> tuple[str, list[Value | None]]:
    """Return the first type that reads every text of a column, and the values; empty is none."""
    for name, read in readers:
        try:
            return name, [read(t) if t or name == "STRING" else None for t in texts]
        except (KeyError, ValueError):
            continue
    raise AssertionError("every text is a STRING")


def _table(path: Path, tags: Iterable[Tag]) -> TagTable:
    try:
        return TagTable(tags)
    except ValueError as error:
        raise wrong(path, 1, str(error), "each tag once") from None


def _trace(tags: TagTable, rows: Iterable[tuple[int, Iterable[Value | None]]]) -> Trace:
    """Return a trace from complete rows: only what changed goes into a frame."""
    trace = Trace(tags)
    last: list[Value | None] = [None] * len(tags)
    for t_ns, row in rows:
        now = list(row)
        changes = tuple((i, v) for i, v in enumerate(now)
                        if v != last[i] or (v is None) is not (last[i] is None))
        trace.observe(Frame(t_ns, len(trace.frames), changes))
        last = now
    return trace


# .jsonl: an object with the tags, one for each frame, one for the end.

_TAG_KEYS = ("name", "type", "unit", "address", "comment")


def _write_jsonl(trace: Trace, file: TextIO) -> None:
    def line(content: dict[str, object]) -> None:
        file.write(json.dumps(content, ensure_ascii=False) + "\n")

    always = ("name", "type", "unit")
    line({"tags": [{key: getattr(tag, key) for key in _TAG_KEYS
                    if key in always or getattr(tag, key)}
                   | ({"values": dict(tag.values)} if tag.values else {}) for tag in trace.tags]})
    for frame in trace.frames:
        line({"t_ns": frame.t_ns, "scan": frame.scan,
              "changes": {trace.tags[i].name: value for i, value in frame.changes}})
    line({"end_ns": trace.end_ns})


def _read_jsonl(path: Path) -> Trace:
    trace: Trace | None = None
    times: list[int] = []
    for number, content in _objects(path):
        if trace is None:
            trace = Trace(_declared(path, number, content))
        elif "end_ns" in content:
            trace.end_ns = max(trace.end_ns, _whole(path, number, content, "end_ns"))
        else:
            times.append(_instant(path, number, str(_whole(path, number, content, "t_ns")), times))
            trace.observe(_frame(path, number, content, trace.tags))
    if trace is None:
        raise wrong(path, 1, "nothing", 'an object with "tags"')
    return trace


def _objects(path: Path) -> Iterator[tuple[int, dict[str, object]]]:
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            try:
                content = json.loads(line) if line.strip() else {}
            except ValueError as error:
                raise wrong(path, number, f"no JSON ({error})", "a JSON object") from None
            if not isinstance(content, dict):
                raise wrong(path, number, repr(content), "a JSON object")
            if content:
                yield number, content


def _declared(path: Path, number: int, content: dict[str, object]) -> TagTable:
    rows = content.get("tags")
    if not isinstance(rows, list):
        raise wrong(path, number, f"the keys {', '.join(content)}", 'an object with "tags"')
    for row in rows:
        if not isinstance(row, dict) or not {"name", "type"} <= row.keys():
            raise wrong(path, number, repr(row), "a tag with name and type")
    return _table(path, [Tag(**{key: str(row.get(key, "")) for key in _TAG_KEYS},
                             values=_values(path, number, row)) for row in rows])


def _values(path: Path, number: int, row: dict[str, object]) -> tuple[tuple[str, int], ...]:
    """Read the values of an enumeration."""
    found = row.get("values", {})
    if not isinstance(found, dict) or not all(isinstance(v, int) for v in found.values()):
        raise wrong(path, number, f"values {found!r}", "an object of names and whole numbers")
    return tuple(found.items())


def _whole(path: Path, number: int, content: dict[str, object], key: str) -> int:
    value = content.get(key)
    if not isinstance(value, int) or isinstance(value, bool):
        raise wrong(path, number, f"{key} {value!r}", "a whole number")
    return value


def _frame(path: Path, number: int, content: dict[str, object], tags: TagTable) -> Frame:
    named = content.get("changes")
    if not isinstance(named, dict):
        raise wrong(path, number, f"changes {named!r}", "an object of tags and values")
    changes: dict[int, Value | None] = {}
    for name, value in named.items():
        if name not in tags:
            raise wrong(path, number, f"the tag {name!r}", "one of the tags of line 1")
        if value is not None and not isinstance(value, (bool, int, float, str)):
            raise wrong(path, number, f"{name}: {value!r}",
                        "a truth value, a number, a text or null")
        changes[tags.find(name)] = value
    return Frame(_whole(path, number, content, "t_ns"), _whole(path, number, content, "scan"),
                 tuple(sorted(changes.items())))


def _write_vcd(trace: Trace, file: TextIO) -> None:
    # pyvcd is wanted only by those who ask for a wave file.
    from plcemu.base import vcdfile

    vcdfile.write(trace, file)


def _read_vcd(path: Path) -> Trace:
    from plcemu.base import vcdfile

    return vcdfile.read(path)


FORMATS: dict[str, Format] = {
    ".csv": Format(_write_csv, _read_csv),
    ".jsonl": Format(_write_jsonl, _read_jsonl),
    ".vcd": Format(_write_vcd, _read_vcd),
}
