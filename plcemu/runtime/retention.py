"""Retention: keeps the retained variables of a running resource in a file, and shows how."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from plcemu.base.tags import Tag
from plcemu.base.types import Value
from plcemu.engine.resource import Resource
from plcemu.io.committer import Committer, Progress
from plcemu.io.retain import Commit, Found, RetainedImage, RetainFile
from plcemu.ir.shape import Match

_LOG = logging.getLogger("plcemu.retain")

PATIENCE_S = 5.0
"""How long the last commit of a run may take, in s; then the run ends without."""

TOLD = 20
"""Names told at most in one log line."""


class Retention:
    """Takes the retained variables over at the start, and commits them when they have changed.

    A state is handed to the committing thread at the end of a scan, when retained bytes differ
    from those handed over last and `interval_ns` of wall time has passed since then.

    Args:
        path: of the file.
        interval_ns: the shortest wall time between two commits.
        resource: whose variables they are.
        cold: leave the file's values alone; the next commit replaces them.

    Attributes:
        match: what was taken over from the file; None at a first or cold start.
        problems: what was wrong with the file.
        start: `first`, `cold` or `warm`.
    """

    def __init__(self, path: Path, interval_ns: int, resource: Resource,
                 cold: bool = False) -> None:
        self.path = path
        self._interval_ns = interval_ns
        self._file = RetainFile(path)
        self._take(resource)
        self.match: Match | None = None
        found = self._file.read() if self._variables else Found(is_first=True)
        self.problems = found.problems
        self.start = "first" if found.is_first else "cold" if cold or found.commit is None \
            else "warm"
        commit = found.commit
        if commit is not None and not cold:
            self._restore(commit, resource)
        elif commit is not None:
            with contextlib.suppress(OSError):  # a courtesy: a cold start was asked for
                self._file.keep_previous()
        self._tell(commit)
        began = Progress(commit.sequence, commit.wall_ns) if commit is not None else Progress()
        self._committer = Committer(self._file, began)
        self._handed: bytes | None = None if self.start != "warm" or self.match is None \
            or self.match.dropped or self.match.added else self._image.gather(self._block)
        self._next_ns = 0
        self._told = ""
        self.tags = [
            Tag("retain.commits", "ULINT", comment="number of the last commit on the disk"),
            Tag("retain.committed_at", "DATE_AND_TIME", comment="when it was made"),
            Tag("retain.committed_scan", "LINT",
                comment="the scan of this run whose state it holds, -1 before the first"),
            Tag("retain.pending", "BOOL", comment="a changed state is not on the disk yet"),
            Tag("retain.failed", "BOOL", comment="the last commit failed"),
            Tag("retain.error", "STRING[254]", comment="why it failed"),
            Tag("retain.dropped", "UDINT", comment="variables of the file that did not fit"),
        ]

    def _take(self, resource: Resource) -> None:
        self._block = resource.memory.block
        self._variables = resource.program.layout.retained
        self._image = RetainedImage(self._variables)

    def _restore(self, commit: Commit, resource: Resource) -> None:
        self.match = self._image.match(commit)
        self.match.carry(commit.data, resource.memory.block)
        resource.inputs_changed()
        if self.match.dropped:
            self.problems.append("retained variables that do not fit are dropped: "
                                 f"{names(self.match.dropped)}; the next commit keeps the file "
                                 f"with them as {self._file.previous}")

    def _tell(self, commit: Commit | None) -> None:
        for problem in self.problems:
            _LOG.warning("%s", problem)
        if not self._variables:
            return
        if self.match is not None and commit is not None:
            _LOG.info("warm start: retained variables of commit %d in %s", commit.sequence,
                      self.path)
        else:
            _LOG.info("%s start: retained variables at their initial values; they are kept in %s",
                      self.start, self.path)

    # ------------------------------------------------------------ while it runs

    def values(self) -> Sequence[Value]:
        """Return the values of the tags."""
        progress = self._committer.progress
        match = self.match
        return (progress.sequence, progress.wall_ns, progress.scan, self._committer.pending,
                bool(progress.error), progress.error[:254].encode("latin-1", "replace")
                .decode("latin-1"), len(match.dropped) if match else 0)

    def after_scan(self, scan: int) -> None:
        """Hand over the state after a scan, if it is time to."""
        self._tell_errors()
        if time.monotonic_ns() >= self._next_ns:
            self.hand_over(scan)

    def _hand_over(self, data: bytes, scan: int) -> None:
        self._committer.submit(self._image.schema, data, scan)
        self._handed = data
        self._next_ns = time.monotonic_ns() + self._interval_ns

    def _tell_errors(self) -> None:
        error = self._committer.progress.error
        if error != self._told and not self._committer.pending:
            self._told = error
            if error:
                _LOG.error("%s; the PLC goes on, but its retained variables are kept only as of "
                           "commit %d; it tries again", error, self._committer.progress.sequence)
            else:
                _LOG.info("retained variables are kept again")

    def hand_over(self, scan: int) -> None:
        """Hand over the state after a scan now, if it has changed."""
        if not self._variables:
            return
        data = self._image.gather(self._block)
        if data != self._handed or self._committer.progress.error:
            self._hand_over(data, scan)

    def wait(self) -> Progress:
        """Wait until what was handed over is on the disk, and return how it stands."""
        self._committer.flush(PATIENCE_S)
        return self._committer.progress

    def finish(self, scan: int) -> None:
        """Make the last commit of a run."""
        self.hand_over(scan)
        progress = self.wait()
        if not self._committer.close(PATIENCE_S):
            _LOG.error("the last commit of the retained variables takes longer than %g s; the "
                       "run ends without it", PATIENCE_S)
        elif progress.error:
            _LOG.error("%s; retained variables are kept as of commit %d", progress.error,
                       progress.sequence)
        elif self._variables:
            _LOG.info("retained variables are kept: commit %d", progress.sequence)

    def changed(self, resource: Resource) -> None:
        """Go on with the variables of an edited program, from the next scan on."""
        if not self._variables:  # the file was not looked at yet
            self._committer.progress = Progress(_sequence(self._file.read()))
        self._take(resource)
        self._handed, self._next_ns = None, 0

    def report(self) -> dict[str, object]:
        """Return how it stands, as plain values."""
        progress, match = self._committer.progress, self.match
        return {"file": str(self.path), "start": self.start, "commits": progress.sequence,
                "error": progress.error, "problems": self.problems,
                "dropped": list(match.dropped) if match else [],
                "added": list(match.added) if match else []}


def _sequence(found: Found) -> int:
    return found.commit.sequence if found.commit is not None else 0


class KeptInStep:
    """Keeps retained variables without a thread: whoever calls `keep` waits for the disk.

    So it is in virtual time, where the same run must give the same files.

    Args:
        path: of the file.
        resource: takes what the file holds and fits.

    Attributes:
        problems: what was wrong with the file, and what did not fit.
    """

    def __init__(self, path: Path, resource: Resource) -> None:
        self._file = RetainFile(path)
        self._kept: tuple[bytes, bytes] | None = None
        found = self._file.read()
        self.problems = found.problems
        if found.commit is None:
            return
        image = RetainedImage(resource.program.layout.retained)
        match = image.match(found.commit)
        match.carry(found.commit.data, resource.memory.block)
        self._kept = found.commit.schema, found.commit.data
        if match.dropped:
            self.problems.append(f"dropped, since they do not fit: {names(match.dropped)}")

    def keep(self, resource: Resource) -> None:
        """Bring the file up to date; raises `RetainError` if that fails."""
        if not resource.program.layout.retained:
            return
        image = RetainedImage(resource.program.layout.retained)
        state = image.schema, image.gather(resource.memory.block)
        if state != self._kept:
            self._file.commit(*state)
            self._file.close()  # so that another PLC may take over
            self._kept = state


def names(every: Sequence[str]) -> str:
    """Return names as a text of bounded length."""
    more = f" and {len(every) - TOLD} more" if len(every) > TOLD else ""
    return ", ".join(every[:TOLD]) + more


def default_path(config_file: Path) -> Path:
    """Return where the retained variables of a configuration are kept when it does not say.

    That is under `$STATE_DIRECTORY`, which systemd sets, or `$XDG_STATE_HOME/plcemu`, usually
    `~/.local/state/plcemu`; with the configuration's path in the name, so that no two share a file.
    """
    full = config_file.resolve()
    mark = hashlib.blake2b(str(full).encode(), digest_size=4).hexdigest()
    return state_folder() / f"{full.parent.name or 'root'}-{mark}.retain"


def state_folder() -> Path:
    """Return the folder for what outlives a run."""
    systemd = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if systemd:
        return Path(systemd)
    base = os.environ.get("XDG_STATE_HOME", "")
    try:
        return (Path(base) if base.startswith("/") else Path.home() / ".local" / "state") / "plcemu"
    except RuntimeError:  # a user without a home, as in some containers
        return Path(tempfile.gettempdir()) / f"plcemu-{os.getuid()}"
