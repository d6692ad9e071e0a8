"""Real-time quality: what a process can ask of the operating system so that its cycle is punctual.

Each setting is tried on its own. One that the system or the user's rights do not allow is a warning
with what to do, and the daemon goes on without it. All are undone at the end.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import logging
import os
import resource as limits
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

_LOG = logging.getLogger("plcemu.realtime")

_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30  # linux/prctl.h
_MCL_CURRENT, _MCL_FUTURE = 1, 2  # sys/mman.h
_CAP_IPC_LOCK = 14  # linux/capability.h

Undo = Callable[[], object]


class Settings(Protocol):
    """What can be asked for; `plcemu.runtime.config.RealtimeSection` is one."""

    @property
    def timer_slack(self) -> int:
        """By how much the kernel may delay a wake-up, in ns."""

    @property
    def scheduler(self) -> str:
        """`other` (the system's usual one) or `fifo` (before all that is not real-time)."""

    @property
    def priority(self) -> int:
        """Among `fifo` processes, from 1 to 99."""

    @property
    def cpus(self) -> list[int] | None:
        """The processors to run on; None for all."""

    @property
    def lock_memory(self) -> bool:
        """Whether to keep all memory in RAM."""

    @property
    def gc_freeze(self) -> bool:
        """Whether to keep what lives at the start out of the garbage collector's way."""


class NotAllowedError(Exception):
    """A setting cannot be had; the text says why and what to do."""


@contextlib.contextmanager
def real_time(settings: Settings) -> Iterator[list[str]]:
    """Apply settings to this thread and process until the end of the block.

    Yields:
        The warnings, which are also logged: one for each setting that could not be had.
    """
    warnings = []
    with contextlib.ExitStack() as undoing:
        for apply in (_set_slack, _set_cpus, _set_scheduler, _set_locking, _set_freeze):
            try:
                undoing.callback(apply(settings))
            except NotAllowedError as problem:
                warnings.append(str(problem))
                _LOG.warning("%s", problem)
        yield warnings


def _nothing() -> None:
    pass


def _set_slack(settings: Settings) -> Undo:
    """Set the timer slack of this thread (prctl(2)); 50 us by default, which every sleep feels."""
    libc = _libc()
    before = libc.prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0) if hasattr(libc, "prctl") else -1
    if before < 0 or libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(settings.timer_slack),
                                0, 0, 0) != 0:
        return _nothing  # a system without: nothing was promised that could be missed
    return lambda: libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(before), 0, 0, 0)


def _set_cpus(settings: Settings) -> Undo:
    if settings.cpus is None:
        return _nothing
    try:
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, settings.cpus)
    except (OSError, AttributeError, ValueError) as problem:
        known = ", ".join(map(str, sorted(_usable_cpus())))
        raise NotAllowedError(f"realtime.cpus: {settings.cpus} cannot be had ({_why(problem)}); "
                              f"this process may run on {known or 'any'}") from None
    return lambda: os.sched_setaffinity(0, before)


def _usable_cpus() -> set[int]:
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


def _set_scheduler(settings: Settings) -> Undo:
    """Take SCHED_FIFO for this thread; its children do not inherit it (sched(7))."""
    if settings.scheduler != "fifo":
        return _nothing
    try:
        before, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK,
                              os.sched_param(settings.priority))
    except (OSError, AttributeError) as problem:
        raise NotAllowedError(
            f"realtime.scheduler: fifo cannot be had ({_why(problem)}), going on without; it needs "
            "CAP_SYS_NICE or an rtprio limit (systemd: LimitRTPRIO=99, limits.conf: rtprio 99)"
        ) from None
    return lambda: os.sched_setscheduler(0, before, parameter)


def _set_locking(settings: Settings) -> Undo:
    """Lock all memory, present and future (mlockall(2)).

    Under a finite limit a later allocation would fail, so nothing is locked then.
    """
    if not settings.lock_memory:
        return _nothing
    libc = _libc()
    hint = ("going on without; it needs CAP_IPC_LOCK or no memlock limit (systemd: "
            "LimitMEMLOCK=infinity)")
    if not hasattr(libc, "mlockall") or not _may_lock():
        raise NotAllowedError(f"realtime.lock_memory: cannot be had, {hint}")
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        why = os.strerror(ctypes.get_errno())
        raise NotAllowedError(f"realtime.lock_memory: cannot be had ({why}), {hint}")
    return libc.munlockall


def _may_lock() -> bool:
    if limits.getrlimit(limits.RLIMIT_MEMLOCK)[0] == limits.RLIM_INFINITY:
        return True
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return False
    held = next((int(line.split()[1], 16) for line in lines if line.startswith("CapEff:")), 0)
    return bool(held >> _CAP_IPC_LOCK & 1)


def _set_freeze(settings: Settings) -> Undo:
    """Keep what lives now out of the collector's way: a full collection would stop the scan."""
    if not settings.gc_freeze:
        return _nothing
    gc.collect()
    gc.freeze()
    return gc.unfreeze


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _why(problem: Exception) -> str:
    return problem.strerror or str(problem) if isinstance(problem, OSError) else \
        "this system has no such call" if isinstance(problem, AttributeError) else str(problem)
