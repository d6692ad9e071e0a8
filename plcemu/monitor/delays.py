"""What tags were some time before: the values that `ago(tag, duration)` reads.

Each delayed value stands behind the tags in the list of values, and changes when its tag did, so
much later. What is kept are the changes within the duration, never samples.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from plcemu.base.trace import Change, Frame
from plcemu.base.types import Value
from plcemu.monitor.bind import Delay

LIMIT = 100_000
"""The largest number of changes that wait in one line."""


class DelayLines:
    """All delayed values of a suite.

    Attributes:
        next_ns: when the next waiting change comes to be seen; None if none waits.
    """

    def __init__(self, delays: Sequence[Delay]) -> None:
        self.next_ns: int | None = None
        self._waiting: list[tuple[Delay, deque[tuple[int, Value | None]]]] = [
            (delay, deque()) for delay in delays]

    def start(self, values: list[Value | None]) -> None:
        """Take the first values; before the start everything was what it is there."""
        for delay, _ in self._waiting:
            values[delay.slot] = values[delay.source]

    def joined(self, frame: Frame) -> Frame:
        """Return the frame with the delayed changes that come to be seen at its instant."""
        if self.next_ns is None or self.next_ns > frame.t_ns:
            return frame
        due: list[Change] = []
        for delay, line in self._waiting:
            while line and line[0][0] <= frame.t_ns:
                due.append((delay.slot, line.popleft()[1]))
        return Frame(frame.t_ns, frame.scan, (*frame.changes, *due))

    def feed(self, frame: Frame) -> Iterable[int]:
        """Let the frame's changes wait; return the slots whose line is too long."""
        changes = dict(frame.changes)
        full = []
        for delay, line in self._waiting:
            if delay.source in changes:
                line.append((frame.t_ns + delay.delay_ns, changes[delay.source]))
                if len(line) > LIMIT:
                    line.clear()
                    full.append(delay.slot)
        self.next_ns = min((line[0][0] for _, line in self._waiting if line), default=None)
        return full
