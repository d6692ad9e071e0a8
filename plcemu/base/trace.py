"""Frames and traces: what every recorder, monitor and replay exchanges.

A trace is a tag table and frames. The first frame holds every tag, each later one the tags that
changed; values hold until the next frame (piecewise constant, right-continuous). A scan in which
nothing changed leaves no frame in a trace. A change to None says that the value is not known from
then on, because its source failed or is stale (quality *bad*), until its next change.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

from plcemu.base.errors import LimitError
from plcemu.base.tags import TagTable
from plcemu.base.types import Value

Change = tuple[int, Value | None]
"""A tag's index in the trace's tag table, and its new value; None: not known (of bad quality)."""


@dataclass(frozen=True, slots=True)
class Frame:
    """What changed at one instant.

    Attributes:
        t_ns: the instant, in ns.
        scan: the number of the scan that made it, from 0.
        changes: the changed tags, in order of their index.
    """

    t_ns: int
    scan: int
    changes: tuple[Change, ...]


class Observer(Protocol):
    """Who is shown every frame; it never writes back."""

    def observe(self, frame: Frame) -> None:
        """Take one frame; frames come in order of time, and an instant comes once."""


@dataclass(slots=True)
class Trace:
    """A recorded run.

    Attributes:
        tags: the tags that the changes' indices refer to.
        frames: in order of time.
        end_ns: how long the last values hold; the trace is cut there.
        limit: the largest number of frames kept; recording more raises `LimitError`.
    """

    tags: TagTable
    frames: list[Frame] = field(default_factory=list)
    end_ns: int = 0
    limit: int = 10_000_000

    def observe(self, frame: Frame) -> None:
        """Append a frame, unless nothing changed in it.

        Raises:
            LimitError: the trace holds `limit` frames already.
        """
        self.end_ns = max(self.end_ns, frame.t_ns)
        if not frame.changes and self.frames:
            return
        if len(self.frames) >= self.limit:
            raise LimitError(f"the trace is full ({self.limit} frames); record a shorter time")
        self.frames.append(frame)

    def cut(self, scan: int) -> None:
        """Forget the frames of a scan and of all later ones."""
        del self.frames[bisect_left(self.frames, scan, key=lambda frame: frame.scan):]
        self.end_ns = self.frames[-1].t_ns if self.frames else 0

    def values(self) -> Iterator[tuple[int, dict[int, Value | None]]]:
        """Yield (t_ns, all values by tag index) after each frame; the dict is reused."""
        state: dict[int, Value | None] = {}
        for frame in self.frames:
            state.update(frame.changes)
            yield frame.t_ns, state

    def history(self, name: str) -> list[tuple[int, Value | None]]:
        """Return the (t_ns, value) changes of one tag.

        Raises:
            UnknownNameError: there is no such tag.
        """
        index = self.tags.find(name)
        return [(f.t_ns, v) for f in self.frames for i, v in f.changes if i == index]
