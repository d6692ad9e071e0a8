"""Time is an integer of nanoseconds, `t_ns`, since the start of the resource.

Durations as text are read and written here, and here stand the two clocks. Only the cycle loop
holds a clock; everything else is passed `t_ns`.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Protocol

from plcemu.base.errors import PlcemuError

NS_PER_S = 1_000_000_000
UNITS_NS = {"d": 86_400 * NS_PER_S, "h": 3_600 * NS_PER_S, "m": 60 * NS_PER_S, "min": 60 * NS_PER_S,
            "s": NS_PER_S, "ms": 1_000_000, "us": 1_000, "µs": 1_000, "ns": 1}

_PART = re.compile(r"(\d[\d_]*(?:\.\d+)?)\s*(ms|us|µs|ns|min|d|h|m|s)", re.IGNORECASE | re.ASCII)
_PREFIX = re.compile(r"(?:l?time|lt|t)#", re.IGNORECASE)


class DurationError(PlcemuError):
    """A text is not a duration."""


def parse_duration_ns(text: str | int | float) -> int:
    """Read a duration as ns: `"10ms"`, `"1.5s"`, `"T#1s500ms"`, `"1h 30min"`; an int is ns already.

    Raises:
        DurationError: the text is no duration, or is not a whole number of ns.
    """
    if isinstance(text, int) and not isinstance(text, bool):
        return text
    original, rest = text, str(text).strip()
    rest = _PREFIX.sub("", rest, count=1) if _PREFIX.match(rest) else rest
    sign, rest = (-1, rest[1:]) if rest.startswith("-") else (1, rest)
    total, position = Fraction(0), 0
    while match := _PART.match(rest, position):
        total += Fraction(match[1].replace("_", "")) * UNITS_NS[match[2].lower()]
        position = match.end()
        while position < len(rest) and rest[position] in "_ ":
            position += 1
    if position == 0 or position != len(rest) or total.denominator != 1:
        raise DurationError(
            f"{original!r} is not a duration; write a number and a unit of d, h, min, s, ms, us "
            "or ns, such as 10ms, 1.5s or T#1s500ms")
    return sign * int(total)


def format_duration(t_ns: int) -> str:
    """Write ns as the shortest text that reads back to the same value, such as `1.5s`."""
    sign, t_ns = ("-", -t_ns) if t_ns < 0 else ("", t_ns)
    for unit in ("s", "ms", "us"):
        if t_ns == 0 or t_ns >= UNITS_NS[unit]:
            whole, part = divmod(t_ns, UNITS_NS[unit])
            digits = str(part).rjust(len(str(UNITS_NS[unit])) - 1, "0").rstrip("0")
            return f"{sign}{whole}{'.' + digits if digits else ''}{unit}"
    return f"{sign}{t_ns}ns"


class Clock(Protocol):
    """What the cycle loop waits on."""

    def now_ns(self) -> int:
        """Return the time since the start of the resource, in ns."""

    async def sleep_until_ns(self, t_ns: int) -> None:
        """Return at the first instant not before `t_ns`."""


class VirtualClock:
    """A clock that jumps: sleeping until `t_ns` makes it `t_ns` at once."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now_ns(self) -> int:
        """Return the instant last jumped to, in ns."""
        return self._now_ns

    async def sleep_until_ns(self, t_ns: int) -> None:
        """Jump to `t_ns`; never back."""
        self._now_ns = max(self._now_ns, t_ns)
