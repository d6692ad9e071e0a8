"""Retained variables in a file: bytes, names and types; of engines this knows nothing.

The file has two slots, each a whole commit with its own checksum. A commit overwrites the older
slot in place and syncs it, so that the newer one stays whole whenever the process or the machine
dies. That costs a third of a new file with rename (0.4 ms against 1.2 ms up to 10,000 bytes, on
ext4 on an SSD; for 1 MB the checksum makes them equal; benchmarks/retain_cost.py), none of it in
the scan, which hands the bytes to a thread; and a disk that is full later cannot fail it. Only a
new set of variables makes a new file, by rename.

A slot begins at a multiple of `BLOCK` bytes:

    magic, version, sequence number, wall time in ns, lengths of data and schema,
    digest of the schema, digest of all before and of the data | data | schema

The schema tells names, types and places in the data, so that another program can take what fits.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import struct
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.ir.shape import Match, Variable, from_plain, match, to_plain

BLOCK = 4096
MAGIC = b"PLCretai"
VERSION = 1
_HEAD = struct.Struct("<8sI4xQQII16s")
_DIGEST_BYTES = 16
_DATA_AT = _HEAD.size + _DIGEST_BYTES

FILE_LIMIT = 256_000_000
"""A larger file, in bytes, is not taken for one of ours."""

KEPT_ASIDE = 5
"""Damaged files kept beside the file; older ones go."""


class RetainError(PlcemuError):
    """The retained variables cannot be read or written; the PLC goes on without."""


@dataclass(frozen=True, slots=True)
class Commit:
    """One state of the retained variables.

    Attributes:
        sequence: counts the commits of a file, from 1, over all restarts.
        wall_ns: when it was made, in ns since 1970.
        schema: names, types and places, as JSON.
        data: the variables' bytes.
    """

    sequence: int
    wall_ns: int
    schema: bytes
    data: bytes

    def variables(self) -> list[Variable]:
        """Return the variables and their places in the data; raises `ValueError` if unreadable."""
        try:
            return [Variable(name, of, from_plain(plain), at)
                    for name, of, plain, at in json.loads(self.schema)]
        except (TypeError, KeyError, AttributeError, RecursionError) as problem:
            raise ValueError(f"its schema cannot be read: {problem!r}") from None


def _digest(*parts: bytes) -> bytes:
    made = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for part in parts:
        made.update(part)
    return made.digest()


def pack(commit: Commit) -> bytes:
    """Return the bytes of a slot, without what fills its last block."""
    head = _HEAD.pack(MAGIC, VERSION, commit.sequence, commit.wall_ns, len(commit.data),
                      len(commit.schema), _digest(commit.schema))
    return b"".join((head, _digest(head, commit.data), commit.data, commit.schema))


def unpack(raw: bytes, at: int) -> Commit | None:
    """Return the commit in the slot at an offset, or None if there is no whole one."""
    if len(raw) < at + _DATA_AT or raw[at:at + len(MAGIC)] != MAGIC:
        return None
    head = raw[at:at + _HEAD.size]
    _, version, sequence, wall_ns, data_bytes, schema_bytes, schema_digest = _HEAD.unpack(head)
    data_end = at + _DATA_AT + data_bytes
    data, schema = raw[at + _DATA_AT:data_end], raw[data_end:data_end + schema_bytes]
    if version != VERSION or raw[at + _HEAD.size:at + _DATA_AT] != _digest(head, data) \
            or _digest(schema) != schema_digest:
        return None
    return Commit(sequence, wall_ns, schema, data)


def slot_bytes(commit: Commit) -> int:
    """Return the bytes that a slot for a commit takes in the file."""
    return -(-(_DATA_AT + len(commit.data) + len(commit.schema)) // BLOCK) * BLOCK


# ---------------------------------------------------------------- variables and their bytes


class RetainedImage:
    """Gathers the bytes of retained variables out of a memory block, and puts them back."""

    def __init__(self, variables: Sequence[Variable]) -> None:
        self._variables = tuple(variables)
        self._ranges = _merged((v.offset, v.size) for v in variables)
        self.schema = json.dumps(
            [[v.name, v.type, to_plain(v.shape), self._place(v.offset)] for v in variables],
            separators=(",", ":")).encode()

    def _place(self, offset: int) -> int:
        """Return where a byte of memory stands in the data."""
        before = 0
        for begin, size in self._ranges:
            if begin <= offset < begin + size:
                return before + offset - begin
            before += size
        return before  # of a variable without bytes

    def gather(self, block: Any) -> bytes:
        """Return the variables' bytes."""
        return b"".join([bytes(block[begin:begin + size]) for begin, size in self._ranges])

    def match(self, commit: Commit) -> Match:
        """Return what of a commit fits these variables."""
        return match(commit.variables(), self._variables)


def _merged(ranges: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join ranges that touch or have only a gap of alignment between them."""
    merged: list[tuple[int, int]] = []
    for begin, size in sorted(r for r in ranges if r[1]):
        if merged and begin <= sum(merged[-1]) + 7:
            first, length = merged[-1]
            merged[-1] = (first, max(length, begin + size - first))
        else:
            merged.append((begin, size))
    return merged


# ---------------------------------------------------------------- the file


@dataclass(slots=True)
class Found:
    """What a file held.

    Attributes:
        commit: the newest whole one, or None.
        problems: what was wrong, for the log; empty if nothing was.
        is_first: whether there was no file.
    """

    commit: Commit | None = None
    problems: list[str] = field(default_factory=list)
    is_first: bool = False


class RetainFile:
    """The two-slot file. One thread at a time may use it.

    Args:
        path: of the file; its folder is made when the first commit is.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sequence = 0
        self._fd = -1
        self._lock = -1
        self._schema = b""
        self._slot = 0
        self._slot_bytes = 0
        self._refusal = ""

    # ------------------------------------------------------------ reading

    def read(self) -> Found:
        """Return the newest whole commit; whatever the file holds, this raises nothing."""
        self.close()
        try:
            with self.path.open("rb") as file:
                raw = file.read(FILE_LIMIT + 1)
        except FileNotFoundError:
            return Found(is_first=True)
        except (OSError, ValueError) as problem:
            why = getattr(problem, "strerror", None) or problem
            self._refusal = f"{self.path} cannot be read ({why}), so it is not overwritten"
            return Found(problems=[f"{self.path} cannot be read: {why}"])
        return self._judge(raw)

    def _judge(self, raw: bytes) -> Found:
        slots = [(at, commit) for at in range(0, min(len(raw), FILE_LIMIT), BLOCK)
                 if (commit := unpack(raw, at)) is not None and _is_readable(commit)]
        found = Found(max((c for _, c in slots), key=lambda c: c.sequence, default=None))
        self.sequence = found.commit.sequence if found.commit else 0
        if found.commit is not None and len(slots) == 2:
            self._plan_to_go_on(slots, found.commit)
        else:
            self._complain(found, raw)
        return found

    def _plan_to_go_on(self, slots: list[tuple[int, Commit]], newest: Commit) -> None:
        """Note how to go on in place, which the next commit does if its schema is the same."""
        (first, a), (second, b) = slots
        if a.schema == b.schema and first == 0 and second == slot_bytes(a):
            self._schema, self._slot_bytes = a.schema, second
            self._slot = 1 if newest is a else 0

    def _complain(self, found: Found, raw: bytes) -> None:
        """Say what was lost, and keep the file as it is beside the new one."""
        commit = found.commit
        if commit is None:
            what = "holds no whole commit: retained variables start at their initial values"
        else:
            at = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(commit.wall_ns // 1_000_000_000))
            what = ("has one whole commit instead of two (a commit was interrupted, or the file is "
                    f"damaged): number {commit.sequence} of {at} is used")
        try:
            kept = f"the file is kept as {self._keep_aside(raw)}"
        except OSError as problem:
            kept = f"the file cannot be kept aside: {problem.strerror}"
            self._refusal = f"{self.path} is damaged and {kept}, so it is not overwritten"
        found.problems.append(f"{self.path} {what}; {kept}")

    def _keep_aside(self, raw: bytes) -> Path:
        stem = f"{self.path.name}.damaged-"
        aside = self.path.with_name(f"{stem}{time.time_ns()}")
        _write_synced(aside, raw)
        for old in sorted(self.path.parent.glob(f"{_escaped(stem)}*"))[:-KEPT_ASIDE]:
            old.unlink(missing_ok=True)
        return aside

    # ------------------------------------------------------------ writing

    def commit(self, schema: bytes, data: bytes) -> Commit:
        """Make a commit that survives whatever comes; when this returns, it is on the disk.

        Raises:
            RetainError: it cannot be written; the commits before it still stand.
        """
        made = Commit(self.sequence + 1, time.time_ns(), schema, data)
        try:
            self._take_lock()
            if self._refusal:
                raise RetainError(self._refusal)
            if schema == self._schema:
                self._write_slot(made)
            else:
                self._create(made)
        except OSError as problem:
            self._release()
            raise RetainError(f"{self.path} cannot be written: "
                              f"{problem.strerror or problem}") from None
        self.sequence = made.sequence
        return made

    def _take_lock(self) -> None:
        """Keep other processes away from the file; the lock ends with the process."""
        if self._lock >= 0:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock = os.open(self.path.with_name(f"{self.path.name}.lock"),
                       os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            raise RetainError(f"{self.path} is in use by another process; choose another file "
                              "by the key retain.file") from None
        self._lock = lock

    def _write_slot(self, commit: Commit) -> None:
        if self._fd < 0:
            self._fd = os.open(self.path, os.O_RDWR | os.O_CLOEXEC)
        if os.fstat(self._fd).st_nlink == 0:  # somebody deleted the file
            self._create(commit)
            return
        raw = memoryview(pack(commit))
        raw = raw[:len(raw) - len(commit.schema)]  # which stands in the slot already
        _write_all(self._fd, raw, self._slot * self._slot_bytes)
        os.fdatasync(self._fd)
        self._slot ^= 1

    def _create(self, commit: Commit) -> None:
        """Put a new file with the commit in both slots in the old one's place, which is kept."""
        self._release(keep_lock=True)
        if self.path.exists():
            self.keep_previous()
        size = slot_bytes(commit)
        slot = pack(commit).ljust(size, b"\0")
        temporary = self.path.with_name(f"{self.path.name}.new")
        _write_synced(temporary, slot + slot)
        temporary.replace(self.path)
        _sync_folder(self.path.parent)
        self._schema, self._slot_bytes, self._slot = commit.schema, size, 0

    @property
    def previous(self) -> Path:
        """Where a file is kept that was replaced by one with other variables."""
        return self.path.with_name(f"{self.path.name}.previous")

    def keep_previous(self) -> None:
        """Keep the file as it is under another name as well; raises `OSError` if it cannot be."""
        _write_synced(self.previous, self.path.read_bytes())

    def _release(self, keep_lock: bool = False) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
        if self._lock >= 0 and not keep_lock:
            os.close(self._lock)
            self._lock = -1

    def close(self) -> None:
        """Give back the descriptors; the next commit opens the file again."""
        self._release()


def _is_readable(commit: Commit) -> bool:
    try:
        commit.variables()
    except ValueError:
        return False
    return True


def _escaped(text: str) -> str:
    return "".join(f"[{c}]" if c in "*?[" else c for c in text)


def _write_all(fd: int, data: memoryview, at: int) -> None:
    while data:
        written = os.pwrite(fd, data, at)
        data, at = data[written:], at + written


def _write_synced(path: Path, data: bytes) -> None:
    fd = os.open(path, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_CLOEXEC, 0o600)
    try:
        _write_all(fd, memoryview(data), 0)
        os.fsync(fd)
    except OSError:
        with contextlib.suppress(OSError):
            path.unlink()
        raise
    finally:
        os.close(fd)


def _sync_folder(folder: Path) -> None:
    fd = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
