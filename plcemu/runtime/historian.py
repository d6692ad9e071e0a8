"""Recorders beside the cycle: a ring of the last frames in memory, and the historian on disk.

Both are observers. The historian hands frames to a thread of its own by way of a bounded queue, so
that a slow disk never holds up the scan.
"""

from __future__ import annotations

import fnmatch
import logging
import sqlite3
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

from plcemu.base.errors import PlcemuError
from plcemu.base.historyfile import add_frames, add_run, connect, forget_before
from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Change, Frame, Trace
from plcemu.base.types import Value

_LOG = logging.getLogger("plcemu.historian")

QUEUE_FRAMES = 20_000
"""Frames that may wait for the disk. One more is lost and counted; the next one that finds room
tells the values of those that were lost, so that only instants are missing, never values."""

RETRY_S = 1.0
"""How long to wait after the disk failed, in s."""

ROOM = 0.9
"""To which part of the allowed size a file is brought when it has grown beyond it."""


# ---------------------------------------------------------------- in memory


class Ring:
    """Keeps the last frames in memory, as an observer.

    Args:
        tags: returns the tags that the frames now refer to.
        limit: the number of frames kept.
        span_ns: frames are kept that are not older, if there are no more than `limit`; None keeps
            as many as there is room for.
    """

    def __init__(self, tags: Callable[[], TagTable], limit: int,
                 span_ns: int | None = None) -> None:
        self.limit = limit
        self._tags = tags
        self._of: TagTable | None = None
        self._span_ns = span_ns
        self._frames: deque[Frame] = deque()
        self._values: dict[int, Value | None] = {}
        self._before: tuple[int, int] | None = None

    def observe(self, frame: Frame) -> None:
        """Take a frame; the oldest give way."""
        if self._tags() is not self._of or (self._frames and frame.t_ns <= self._frames[-1].t_ns):
            # Another program, or a return to the past: a frame of all values follows.
            self._of = self._tags()
            self._frames.clear()
            self._values, self._before = {}, None
        if frame.changes:
            self._frames.append(frame)
        while len(self._frames) > self.limit or (
                self._span_ns is not None and self._frames
                and self._frames[0].t_ns < frame.t_ns - self._span_ns):
            old = self._frames.popleft()
            self._values.update(old.changes)
            self._before = (old.t_ns, old.scan)

    def tags_now(self) -> TagTable:
        """Return the tags that frames now refer to."""
        return self._tags()

    def trace(self, begin_ns: int | None = None) -> Trace:
        """Return what is kept, perhaps from an instant on; the first frame holds all values."""
        trace = Trace(self._of if self._of is not None else self._tags())
        values, before = dict(self._values), self._before
        frames = list(self._frames)
        while frames and begin_ns is not None and frames[0].t_ns <= begin_ns:
            old = frames.pop(0)
            values.update(old.changes)
            before = (old.t_ns, old.scan)
        if before is not None:
            at_ns = before[0] if begin_ns is None else max(before[0], begin_ns)
            trace.observe(Frame(at_ns, before[1], tuple(sorted(values.items()))))
        for frame in frames:
            trace.observe(frame)
        return trace


# ---------------------------------------------------------------- on disk


@dataclass(frozen=True, slots=True)
class Keep:
    """What a historian keeps.

    Attributes:
        age_ns: how far back; of runs that ended, by the date. None is any age.
        size: of the file, in bytes; then the oldest frames are forgotten. None is any size.
    """

    age_ns: int | None = None
    size: int | None = None


@dataclass(slots=True)
class Counters:
    """What a historian counts.

    Attributes:
        frames: put on the disk.
        commits: how often.
        lost: frames that found no room in the queue.
        forgotten: frames that were too old or too many.
        waiting: frames in the queue, now.
        error: why the disk fails, or empty.
    """

    frames: int = 0
    commits: int = 0
    lost: int = 0
    forgotten: int = 0
    waiting: int = 0
    error: str = ""

    def as_json(self) -> dict[str, object]:
        """Return them as plain values."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(slots=True)
class _Begin:
    """In the queue: a run begins with these tags."""

    tags: list[Tag]


@dataclass(slots=True)
class _Queue:
    """What waits for the thread."""

    items: deque[_Begin | Frame] = field(default_factory=deque)
    closing: bool = False
    change: threading.Condition = field(default_factory=threading.Condition)


class Historian:
    """Writes frames into an SQLite file, as an observer.

    Args:
        path: the file; made if it is not there.
        name: of the PLC.
        tags: returns the tags that the frames now refer to; another table begins another run.
        chosen: patterns of the tags that are recorded, such as `plant.*`; none for all.
        keep: what is kept.
        interval_s: how often frames are committed, in s: what a kill may lose.
        limit: the number of frames that may wait.

    Raises:
        PlcemuError: the file is no historian's file, or cannot be opened.
    """

    def __init__(self, path: Path, name: str, tags: Callable[[], TagTable],
                 chosen: Sequence[str] = (), keep: Keep = Keep(),
                 interval_s: float = 1.0, limit: int = QUEUE_FRAMES) -> None:
        self.path = path
        self.counters = Counters()
        self._name, self._tags, self._chosen, self._keep = name, tags, tuple(chosen), keep
        self._interval_s, self._limit = interval_s, limit
        self._of: TagTable | None = None
        self._places: dict[int, int] | None = None
        self._missed: dict[int, Value | None] = {}
        self._queue = _Queue()
        self._run: int | None = None
        self._base = connect(path, write=True)
        self._thread = threading.Thread(target=self._work, name="historian", daemon=True)
        self._thread.start()

    # ------------------------------------------------------------ in the cycle

    def observe(self, frame: Frame) -> None:
        """Take a frame; never waits for the disk."""
        tags = self._tags()
        begins = tags is not self._of
        if begins:
            self._begin(tags)
        changes = self._chosen_of(frame.changes)
        if not changes and not self._missed:
            return
        queue = self._queue
        with queue.change:
            if len(queue.items) >= self._limit:
                self._missed.update(changes)
                self.counters.lost += 1
                return
            if self._missed:
                changes = tuple(sorted({**self._missed, **dict(changes)}.items()))
                self._missed = {}
            queue.items.append(Frame(frame.t_ns, frame.scan, changes))
            if len(queue.items) * 2 >= self._limit:
                queue.change.notify()

    def _begin(self, tags: TagTable) -> None:
        self._of, self._missed = tags, {}
        chosen = [i for i, tag in enumerate(tags) if self._is_chosen(tag.name)]
        self._places = None if len(chosen) == len(tags) else \
            {old: new for new, old in enumerate(chosen)}
        with self._queue.change:
            self._queue.items.append(_Begin([tags[i] for i in chosen]))

    def _is_chosen(self, name: str) -> bool:
        return not self._chosen or any(fnmatch.fnmatchcase(name.casefold(), pattern.casefold())
                                       for pattern in self._chosen)

    def _chosen_of(self, changes: tuple[Change, ...]) -> tuple[Change, ...]:
        places = self._places
        return changes if places is None else \
            tuple((places[i], value) for i, value in changes if i in places)

    def close(self) -> None:
        """Put what waits on the disk and end."""
        with self._queue.change:
            self._queue.closing = True
            self._queue.change.notify()
        self._thread.join()
        self._base.close()

    # ------------------------------------------------------------ in the thread

    def _work(self) -> None:
        batch: list[_Begin | Frame] = []
        closing = False
        while not closing:
            queue = self._queue
            with queue.change:
                if not queue.closing:
                    queue.change.wait(RETRY_S if batch else self._interval_s)
                closing = queue.closing
                if len(batch) < self._limit:
                    batch += queue.items
                    queue.items.clear()
            if batch and self._commit(batch):
                batch = []
            self.counters.waiting = len(batch)

    def _commit(self, batch: Sequence[_Begin | Frame]) -> bool:
        """Write a batch in one transaction; return whether that went well."""
        base, run, count = self._base, self._run, 0
        now = datetime.now(UTC)
        try:
            base.execute("BEGIN IMMEDIATE")
            frames: list[Frame] = []
            for item in batch:
                if isinstance(item, _Begin):
                    run, frames = self._write(run, frames), []
                    run = add_run(base, self._name, now.isoformat(), item.tags)
                else:
                    frames.append(item)
                    count += 1
            self._write(run, frames)
            base.execute("UPDATE run SET ended = ? WHERE id = ?", (now.isoformat(), run))
            forgotten = self._forget(run, now)
            base.execute("COMMIT")
            base.executescript("PRAGMA incremental_vacuum;")  # execute() frees one page only
        except sqlite3.Error as problem:
            if base.in_transaction:
                base.execute("ROLLBACK")
            if str(problem) != self.counters.error:
                _LOG.error("%s: %s; frames wait, and are tried again", self.path, problem)
            self.counters.error = str(problem)
            return False
        self._run = run
        counters = self.counters
        counters.frames += count
        counters.commits += 1
        counters.forgotten += forgotten
        counters.error = ""
        return True

    def _write(self, run: int | None, frames: Sequence[Frame]) -> int | None:
        if frames:
            assert run is not None, "a run begins before its frames"
            add_frames(self._base, run, frames)
            self._base.execute("UPDATE run SET end_ns = ? WHERE id = ?", (frames[-1].t_ns, run))
        return run

    def _forget(self, run: int | None, now: datetime) -> int:
        """Forget what is too old, then the oldest while the file is too large."""
        base, keep, forgotten = self._base, self._keep, 0
        if keep.age_ns is not None:
            before = now - timedelta(microseconds=keep.age_ns // 1000)
            forgotten += self._drop_runs("ended < ? AND id <> ?", (before.isoformat(), run))
            (end_ns,) = base.execute("SELECT end_ns FROM run WHERE id = ?", (run,)).fetchone()
            forgotten += forget_before(base, run or 0, end_ns - keep.age_ns)
        if keep.size is not None and self._size() > keep.size:
            forgotten += self._shrink(run or 0, keep.size)
        return forgotten

    def _shrink(self, run: int, size: int) -> int:
        """Forget other runs, oldest first, then the older half of this one's, until there is room.
        """
        forgotten = 0
        while self._size() > size * ROOM:
            oldest = self._base.execute("SELECT min(id) FROM run WHERE id <> ?", (run,)).fetchone()
            if oldest[0] is not None:
                forgotten += self._drop_runs("id = ?", oldest)
                continue
            middle = self._base.execute(
                "SELECT t_ns FROM frame WHERE run = ? ORDER BY id LIMIT 1 OFFSET "
                "(SELECT count(*) / 4 + 1 FROM frame WHERE run = ?)", (run, run)).fetchone()
            gone = forget_before(self._base, run, middle[0]) if middle else 0
            if not gone:
                break
            forgotten += gone
        return forgotten

    def _drop_runs(self, where: str, values: tuple[object, ...]) -> int:
        ids = [row[0] for row in self._base.execute(f"SELECT id FROM run WHERE {where}", values)]
        gone = 0
        for each in ids:
            gone += self._base.execute("DELETE FROM frame WHERE run = ?", (each,)).rowcount
            self._base.execute("DELETE FROM tag WHERE run = ?", (each,))
            self._base.execute("DELETE FROM run WHERE id = ?", (each,))
        return gone

    def _size(self) -> int:
        """Return the bytes of the file that are in use."""
        pages, free, size = (self._base.execute(f"PRAGMA {what}").fetchone()[0]
                             for what in ("page_count", "freelist_count", "page_size"))
        return int((pages - free) * size)


def check_place(path: Path) -> None:
    """Refuse a file that could not be written.

    Raises:
        PlcemuError: it is a folder, or its folder does not exist.
    """
    if path.is_dir() or not path.parent.is_dir():
        raise PlcemuError(f"{path}: cannot be written: it is a folder, or in no folder")


