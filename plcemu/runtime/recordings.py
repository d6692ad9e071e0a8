"""Recordings of the seconds before and after an event, written beside the cycle."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from plcemu.base.errors import PlcemuError
from plcemu.base.tags import TagTable
from plcemu.base.time import format_duration
from plcemu.base.trace import Frame, Trace
from plcemu.base.tracefile import FORMATS, save
from plcemu.runtime.historian import Ring

_LOG = logging.getLogger("plcemu.recordings")

FILES = 100
"""Recordings that one run makes at most, so that the disk does not fill up."""

_FIELDS = {"property": "", "t": ""}


@dataclass(slots=True)
class _Open:
    """A recording that still goes on."""

    path: Path
    trace: Trace
    end_ns: int


class Recordings:
    """Keeps the last seconds in memory and writes them, with those that follow, when asked.

    An observer. Files are written in threads of their own, one after another.

    Args:
        tags: returns the tags that the frames now refer to.
        before_ns: the longest time before an event that is asked for.
        ring: the largest number of frames kept for that.
    """

    def __init__(self, tags: Callable[[], TagTable], before_ns: int, ring: int) -> None:
        self._ring = Ring(tags, ring, before_ns)
        self._open: list[_Open] = []
        self._threads: list[threading.Thread] = []
        self._writing = threading.Lock()
        self._begun = 0
        self._taken: set[Path] = set()

    def observe(self, frame: Frame) -> None:
        """Take a frame; write the recordings that have come to their end."""
        ended = [each for each in self._open if frame.t_ns > each.end_ns
                 or self._ring.tags_now() is not each.trace.tags]
        for each in ended:
            self._open.remove(each)
            self._write(each)
        for each in self._open:
            each.trace.observe(frame)
        self._ring.observe(frame)

    def start(self, name: str, t_ns: int, before_ns: int, after_ns: int, pattern: str) -> None:
        """Begin a recording; the frame of this instant is seen after it.

        Args:
            name: of the property.
            t_ns: the instant of the event.
            before_ns: how much before it is recorded.
            after_ns: how much after it.
            pattern: of the file's name, with `{property}` and `{t}`.
        """
        self._begun += 1
        if self._begun > FILES:
            if self._begun == FILES + 1:
                _LOG.error("%d recordings were made; no more are", FILES)
            return
        path = self._free(Path(pattern.format(property=name, t=format_duration(t_ns))))
        self._taken.add(path)
        self._open.append(_Open(path, self._ring.trace(t_ns - before_ns), t_ns + after_ns))

    def close(self) -> None:
        """Write the recordings that go on, cut here, and wait for all."""
        for each in self._open:
            self._write(each)
        self._open = []
        for thread in self._threads:
            thread.join()
        self._threads = []

    def _free(self, path: Path) -> Path:
        """Return a path at which there is nothing yet, nor will be."""
        n, free = 1, path
        while free.exists() or free in self._taken:
            n, free = n + 1, path.with_stem(f"{path.stem}-{n + 1}")
        return free

    def _write(self, recording: _Open) -> None:
        trace = recording.trace
        trace.end_ns = max(trace.end_ns, recording.end_ns)

        def work() -> None:
            with self._writing:
                try:
                    save(trace, recording.path)
                    _LOG.info("recorded %s", recording.path)
                except (OSError, PlcemuError) as problem:
                    _LOG.error("%s: cannot be written: %s", recording.path, problem)

        thread = threading.Thread(target=work, name="recording", daemon=False)
        self._threads = [t for t in self._threads if t.is_alive()] + [thread]
        thread.start()


def check_pattern(pattern: str) -> None:
    """Refuse a file name that cannot be used.

    Raises:
        ValueError: with what is wrong.
    """
    try:
        path = Path(pattern.format(**_FIELDS))
    except (KeyError, IndexError, ValueError, AttributeError):
        raise ValueError(f"found {pattern!r}, expected a file name in which at most {{property}} "
                         "and {t} stand in braces") from None
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"found the ending {path.suffix!r}, expected one of {', '.join(FORMATS)}")
    if not path.parent.is_dir():
        raise ValueError(f"there is no folder {path.parent}")
