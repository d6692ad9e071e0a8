"""Commits retained variables in a thread: the scan hands over bytes and never waits."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from plcemu.io.retain import RetainError, RetainFile


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the commits have come.

    Attributes:
        sequence: of the last commit that is on the disk; 0 if there is none.
        wall_ns: when it was made, in ns since 1970; 0 if there is none.
        scan: the scan whose state it holds, -1 if none of this run.
        error: why the last attempt failed; empty if it did not.
    """

    sequence: int = 0
    wall_ns: int = 0
    scan: int = -1
    error: str = ""


@dataclass(frozen=True, slots=True)
class _Order:
    schema: bytes
    data: bytes
    scan: int


class Committer:
    """Writes the latest state handed over; one that has not begun to be written gives way to it.

    Args:
        file: which the thread has for itself until `close`.
        progress: what stands in the file already.
    """

    def __init__(self, file: RetainFile, progress: Progress) -> None:
        self._file = file
        self.progress = progress
        """Replaced, never changed, so that any thread may read it."""
        self._order: _Order | None = None
        self._busy = False
        self._closing = False
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    @property
    def pending(self) -> bool:
        """Whether a state waits or is being written."""
        return self._busy or self._order is not None

    def submit(self, schema: bytes, data: bytes, scan: int) -> None:
        """Hand over the state after a scan."""
        with self._changed:
            self._order = _Order(schema, data, scan)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="retain", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def flush(self, patience_s: float) -> bool:
        """Wait until everything handed over is on the disk or has failed; False if not in time."""
        with self._changed:
            return self._changed.wait_for(lambda: not self.pending, patience_s)

    def close(self, patience_s: float) -> bool:
        """Finish what was handed over and end the thread; False if that takes longer."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread is None:
            return True
        self._thread.join(patience_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while (order := self._next()) is not None:
            try:
                made = self._file.commit(order.schema, order.data)
                progress = Progress(made.sequence, made.wall_ns, order.scan)
            except RetainError as problem:
                now = self.progress
                progress = Progress(now.sequence, now.wall_ns, now.scan, str(problem))
            with self._changed:
                self.progress, self._busy = progress, False
                self._changed.notify_all()
        self._file.close()

    def _next(self) -> _Order | None:
        with self._changed:
            self._changed.wait_for(lambda: self._order is not None or self._closing)
            order, self._order = self._order, None
            self._busy = order is not None
            return order
