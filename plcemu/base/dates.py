"""Dates and times of day as text and as ns (IEC 61131-3, 2.2.3, tables 7 and 8).

A DATE and a DATE_AND_TIME are ns since 1970-01-01, a TIME_OF_DAY is ns since midnight; there are no
time zones and no leap seconds. 64 bits hold 1677-09-22 to 2262-04-10.
"""

from __future__ import annotations

import datetime
import re

from plcemu.base.time import NS_PER_S, UNITS_NS

DAY_NS = UNITS_NS["d"]
"""A day in ns."""

_EPOCH = datetime.date(1970, 1, 1)
_DATE = re.compile(r"(\d{1,4})-(\d{1,2})-(\d{1,2})", re.ASCII)
_TOD = re.compile(r"(\d{1,2}):(\d{1,2}):(\d{1,2})(?:\.(\d{1,9}))?", re.ASCII)
_FIRST, _LAST = datetime.date(1677, 9, 22), datetime.date(2262, 4, 10)
_PARTS = (("d", DAY_NS), ("h", UNITS_NS["h"]), ("m", UNITS_NS["m"]), ("s", NS_PER_S),
          ("ms", UNITS_NS["ms"]), ("us", UNITS_NS["us"]), ("ns", 1))


def date_ns(year: int, month: int, day: int) -> int:
    """Return a date as ns since 1970-01-01.

    Raises:
        ValueError: there is no such date, or 64 bits do not hold it.
    """
    try:
        date = datetime.date(year, month, day)
    except (ValueError, OverflowError):
        raise ValueError(f"there is no date {year}-{month}-{day}") from None
    if not _FIRST <= date <= _LAST:
        raise ValueError(f"dates go from {_FIRST} to {_LAST}")
    return (date - _EPOCH).days * DAY_NS


def tod_ns(hour: int, minute: int, second: int, ns: int = 0) -> int:
    """Return a time of day as ns since midnight.

    Raises:
        ValueError: there is no such time of day.
    """
    if not (0 <= hour < 24 and 0 <= minute < 60 and 0 <= second < 60 and 0 <= ns < NS_PER_S):
        raise ValueError(f"there is no time of day {hour}:{minute:02}:{second:02}")
    return ((hour * 60 + minute) * 60 + second) * NS_PER_S + ns


def parse_date_ns(text: str) -> int:
    """Read `2024-02-29` as ns since 1970-01-01.

    Raises:
        ValueError: the text is no date.
    """
    match = _DATE.fullmatch(text)
    if match is None:
        raise ValueError("write a date as year-month-day, such as D#2024-02-29")
    return date_ns(int(match[1]), int(match[2]), int(match[3]))


def parse_tod_ns(text: str) -> int:
    """Read `15:36:55.36` as ns since midnight.

    Raises:
        ValueError: the text is no time of day.
    """
    match = _TOD.fullmatch(text)
    if match is None:
        raise ValueError("write a time of day as hour:minute:second, such as TOD#15:36:55.36")
    fraction = int((match[4] or "0").ljust(9, "0"))
    return tod_ns(int(match[1]), int(match[2]), int(match[3]), fraction)


def parse_dt_ns(text: str) -> int:
    """Read `2024-02-29-15:36:55.36` as ns since 1970-01-01.

    Raises:
        ValueError: the text is no date and time.
    """
    date, dash, tod = text.rpartition("-")
    if not dash or not _TOD.fullmatch(tod) or not _DATE.fullmatch(date):
        raise ValueError("write a date and time as year-month-day-hour:minute:second, such as "
                         "DT#2024-02-29-15:36:55.36")
    return parse_date_ns(date) + parse_tod_ns(tod)


def date_of_ns(ns: int) -> datetime.date:
    """Return the date of ns since 1970-01-01."""
    return _EPOCH + datetime.timedelta(days=ns // DAY_NS)


def format_date(ns: int) -> str:
    """Write ns since 1970-01-01 as `2024-02-29`."""
    return date_of_ns(ns).isoformat()


def format_tod(ns: int) -> str:
    """Write ns since midnight as `15:36:55.36`, of any day."""
    seconds, rest = divmod(ns % DAY_NS, NS_PER_S)
    fraction = f".{rest:09}".rstrip("0").rstrip(".")
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}{fraction}"


def format_dt(ns: int) -> str:
    """Write ns since 1970-01-01 as `2024-02-29-15:36:55.36`."""
    return f"{format_date(ns)}-{format_tod(ns)}"


def format_time(ns: int) -> str:
    """Write a TIME in ns with the units it needs, such as `1h30m`, `-2s500ms` or `0s`."""
    sign, rest, text = "-" if ns < 0 else "", abs(ns), ""
    for unit, size in _PARTS:
        count, rest = divmod(rest, size)
        text += f"{count}{unit}" if count else ""
    return sign + (text or "0s")
