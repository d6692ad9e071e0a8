"""The real clock: absolute deadlines on the asyncio loop, by a timerfd where there is one.

The loop's own timers are rounded to whole milliseconds, which a cycle of 1 ms would feel.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import struct
import sys
import time
from fractions import Fraction
from types import TracebackType
from typing import Self

_CLOCK_MONOTONIC = 1
_TFD_FLAGS = 0o4000 | 0o2000000  # TFD_NONBLOCK | TFD_CLOEXEC
_TFD_TIMER_ABSTIME = 1


class RealClock:
    """Time since its start, perhaps scaled; a context manager, since it may hold a descriptor.

    Args:
        speed: ns of this clock for each ns of the wall's.
        spin_ns: how long before the end of a sleep to wake up and poll the clock, in ns of the
            wall's: more punctual, for the price of that much processor time a lap.
    """

    def __init__(self, speed: Fraction = Fraction(1), spin_ns: int = 0) -> None:
        self._speed = speed
        self._spin_ns = spin_ns
        self._start = time.monotonic_ns()
        self._timer = _TimerFd.open() if sys.platform == "linux" else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Give back the descriptor."""
        if self._timer is not None:
            self._timer.close()
            self._timer = None

    def now_ns(self) -> int:
        """Return the time since the start, in ns of this clock."""
        return self._scaled(time.monotonic_ns() - self._start)

    def _scaled(self, wall_ns: int) -> int:
        return wall_ns if self._speed == 1 else int(wall_ns * self._speed)

    async def sleep_until_ns(self, t_ns: int) -> None:
        """Return at the first instant not before `t_ns`; other tasks get a turn in any case."""
        deadline = self.wall_ns(t_ns)
        early = deadline - self._spin_ns
        if early <= time.monotonic_ns():
            await asyncio.sleep(0)
        elif self._timer is not None:
            await self._timer.wait(early)
        while (left := early - time.monotonic_ns()) > 0:
            await asyncio.sleep(left / 1e9)
        while time.monotonic_ns() < deadline:
            pass

    def wall_ns(self, t_ns: int) -> int:
        """Return when it will be `t_ns`, in ns of `time.monotonic_ns` (and of the loop's time)."""
        return self._start + (t_ns if self._speed == 1 else -int(-t_ns // self._speed))


class _TimerFd:
    """A Linux timer as a file descriptor that the event loop can wait for."""

    def __init__(self, libc: ctypes.CDLL, fd: int) -> None:
        self._libc, self._fd = libc, fd

    @classmethod
    def open(cls) -> _TimerFd | None:
        """Return a timer, or None where the platform has none."""
        try:
            libc = ctypes.CDLL(None, use_errno=True)
            fd = libc.timerfd_create(_CLOCK_MONOTONIC, _TFD_FLAGS)
        except (OSError, AttributeError):
            return None
        return cls(libc, fd) if fd >= 0 else None

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self._fd)

    async def wait(self, deadline_ns: int) -> None:
        """Return when the monotonic clock reaches a deadline."""
        loop = asyncio.get_running_loop()
        fired = loop.create_future()
        spec = struct.pack("@qqqq", 0, 0, *divmod(deadline_ns, 1_000_000_000))
        if self._libc.timerfd_settime(self._fd, _TFD_TIMER_ABSTIME, spec, None) != 0:
            return
        loop.add_reader(self._fd, _fire, self._fd, fired)
        try:
            await fired
        finally:
            loop.remove_reader(self._fd)


def _fire(fd: int, fired: asyncio.Future[None]) -> None:
    try:
        os.read(fd, 8)
    except BlockingIOError:
        return
    if not fired.done():
        fired.set_result(None)
