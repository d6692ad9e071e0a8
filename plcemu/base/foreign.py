"""Traces of other tools: tables with a time column of another name or unit, and other tags' names.

A table's times are rounded to whole ns. Rows of one instant are one frame, in which the last one
counts. TRUE and FALSE, in any case, are Booleans.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path

from plcemu.base.errors import PlcemuError, TraceFormatError, did_you_mean
from plcemu.base.tags import TagTable
from plcemu.base.trace import Trace

UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""Units of a time column, in ns."""

DATE = "date"
"""A time column of dates and times (ISO 8601); the first one is the instant 0."""

TIME_COLUMNS = {
    "t_ns": "ns", "time_ns": "ns", "t_us": "us", "time_us": "us", "t_ms": "ms", "time_ms": "ms",
    "t_s": "s", "time_s": "s", "t [s]": "s", "time [s]": "s", "time (s)": "s", "t [ms]": "ms",
    "time [ms]": "ms", "time (ms)": "ms", "seconds": "s", "time": "", "t": "", "timestamp": ""}
"""Names by which a time column is known, and their unit; without one it must be told."""

DELIMITERS = (",", ";", "\t")


@dataclass(frozen=True, slots=True)
class Reading:
    """How a file of another tool is read.

    Attributes:
        time: the name of the time column; None looks for a known one.
        unit: of its times, one of `UNITS` or `date`; None takes it from the column's name.
        delimiter: between columns; None finds it out.
        names: of tags, new ones by old ones.
        run: of a historian's file; None is the last one.
    """

    time: str | None = None
    unit: str | None = None
    delimiter: str | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    run: int | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """A table's columns but for the time, and its rows by instant."""

    names: list[str]
    times: list[int]
    rows: list[list[str]]


def renamed(trace: Trace, names: Mapping[str, str]) -> Trace:
    """Return a trace whose tags have other names.

    Raises:
        PlcemuError: there is no such tag, or two would have one name.
    """
    if not names:
        return trace
    new = {trace.tags.find(old): name for old, name in names.items()}
    try:
        tags = TagTable(replace(tag, name=new.get(i, tag.name))
                        for i, tag in enumerate(trace.tags))
    except ValueError as problem:
        raise PlcemuError(f"renaming: {problem}") from None
    return Trace(tags, trace.frames, trace.end_ns)


def read_table(path: Path, reading: Reading) -> Table:
    """Read a table of texts with its instants, in ns.

    Raises:
        TraceFormatError: there is no time column, or a row does not fit.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        first = file.readline()
        file.seek(0)
        delimiter = reading.delimiter or max(DELIMITERS, key=first.count)
        lines = csv.reader(file, delimiter=delimiter)
        header = [name.strip() for name in next(lines, [])]
        column, unit = _time_column(path, header, reading)
        times: list[int] = []
        rows: list[list[str]] = []
        origin: int | None = None
        for number, row in _rows(path, lines, len(header)):
            t_ns = _instant(path, number, row.pop(column), unit)
            if unit == DATE:
                origin = t_ns if origin is None else origin
                t_ns -= origin
            if t_ns < 0 or (times and t_ns < times[-1]):
                raise TraceFormatError(f"{path}:{number}: found the instant {t_ns} ns, expected "
                                       f"one from {times[-1] if times else 0} ns on")
            if times and t_ns == times[-1]:
                rows[-1] = row
            else:
                times.append(t_ns)
                rows.append(row)
    return Table([*header[:column], *header[column + 1:]], times, rows)


def _rows(path: Path, lines: Iterator[list[str]], width: int) -> Iterator[tuple[int, list[str]]]:
    for number, row in enumerate(lines, 2):
        if any(cell.strip() for cell in row):
            if len(row) != width:
                raise TraceFormatError(f"{path}:{number}: found {len(row)} columns, expected "
                                       f"{width}")
            yield number, [cell.strip() for cell in row]


def _time_column(path: Path, header: list[str], reading: Reading) -> tuple[int, str]:
    """Return the place of the time column and the unit of its times."""
    keys = [name.casefold() for name in header]
    if reading.time is not None:
        wanted = reading.time.strip().casefold()
        if wanted not in keys:
            raise TraceFormatError(f"{path}:1: there is no column {reading.time!r}"
                                   f"{did_you_mean(reading.time, header)}; there is "
                                   f"{', '.join(header)}")
        column = keys.index(wanted)
    else:
        found = next((i for i, key in enumerate(keys) if key in TIME_COLUMNS), None)
        if found is None:
            raise TraceFormatError(f"{path}:1: found {','.join(header)!r}, expected the header "
                                   "t_ns,tag,tag,...; of another tool's table, --time COLUMN says "
                                   "which is the time and --unit its unit")
        column = found
    unit = reading.unit or TIME_COLUMNS.get(keys[column], "")
    if not unit:
        raise TraceFormatError(f"{path}:1: found {','.join(header)!r}, expected the header "
                               f"t_ns,tag,tag,...; or say the unit of {header[column]!r} by --unit "
                               f"{', '.join(UNITS)} or {DATE}")
    return column, unit


def _instant(path: Path, number: int, text: str, unit: str) -> int:
    """Read an instant, rounded to whole ns."""
    try:
        if unit == DATE:
            date = datetime.fromisoformat(text)
            moment = date if date.tzinfo is not None else date.replace(tzinfo=UTC)
            since = moment - datetime(1970, 1, 1, tzinfo=UTC)
            return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000
        value = Decimal(text)
        if not value.is_finite() or abs(value) > 10**18:
            raise ValueError(text)
        return round(value * UNITS[unit])
    except (InvalidOperation, ValueError):
        expected = "a date and time" if unit == DATE else f"a number of {unit}"
        raise TraceFormatError(f"{path}:{number}: found {text!r}, expected {expected}") from None
