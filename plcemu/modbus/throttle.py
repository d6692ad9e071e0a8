"""Log lines about peers' mistakes, limited so that a peer cannot fill the log."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

logger = logging.getLogger("plcemu.modbus")

INTERVAL_S = 5.0
"""The shortest time between two lines of one kind."""


class Throttle:
    """Lets one line of each kind through in an interval and counts the others.

    Args:
        interval_s: the interval.
        now_s: the time, in seconds from any start.
    """

    def __init__(self, interval_s: float = INTERVAL_S,
                 now_s: Callable[[], float] = time.monotonic) -> None:
        self._interval_s = interval_s
        self._now_s = now_s
        self._next_s: dict[str, float] = {}
        self._hidden: dict[str, int] = {}

    def log(self, level: int, kind: str, text: str) -> None:
        """Write a line of a kind or count it; the kind's next line tells how many were hidden."""
        now_s = self._now_s()
        if now_s < self._next_s.get(kind, now_s):
            self._hidden[kind] = self._hidden.get(kind, 0) + 1
            return
        self._next_s[kind] = now_s + self._interval_s
        hidden = self._hidden.pop(kind, 0)
        logger.log(level, "%s%s", text, f" (and {hidden} more of this kind)" if hidden else "")
