"""What a service manager is told: systemd's notification protocol (sd_notify(3))."""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Mapping


class Notifier:
    """Tells systemd how the service stands; without `NOTIFY_SOCKET` it tells nobody.

    Args:
        environment: holds `NOTIFY_SOCKET`, and `WATCHDOG_USEC` with `WATCHDOG_PID`.

    Attributes:
        watchdog_ns: how often systemd wants a sign of life; None if it wants none.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        path = environment.get("NOTIFY_SOCKET", "")
        # A name that begins with @ is in the abstract namespace.
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if path else None
        if self._socket is not None:
            self._socket.setblocking(False)
        self.watchdog_ns = _watchdog_ns(environment) if path else None
        self._next_ns = 0

    def tell(self, **facts: object) -> None:
        """Send facts such as `READY=1`; a manager that does not listen is not waited for."""
        if self._socket is None:
            return
        text = "\n".join(f"{name}={value}" for name, value in facts.items())
        with contextlib.suppress(OSError):
            self._socket.sendto(text.encode(), self._address)

    def reloading(self) -> None:
        """Tell that a reload has begun; `READY=1` ends it."""
        self.tell(RELOADING=1, MONOTONIC_USEC=time.monotonic_ns() // 1000)

    def alive(self) -> None:
        """Give a sign of life, if one is due; called by the cycle, so that a stuck one shows."""
        if self.watchdog_ns is not None and time.monotonic_ns() >= self._next_ns:
            # Four in each interval, so that one or two may be late.
            self._next_ns = time.monotonic_ns() + self.watchdog_ns // 4
            self.tell(WATCHDOG=1)

    def close(self) -> None:
        """Give back the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _watchdog_ns(environment: Mapping[str, str]) -> int | None:
    try:
        interval_us = int(environment.get("WATCHDOG_USEC", "0"))
        pid = int(environment.get("WATCHDOG_PID", str(os.getpid())))
    except ValueError:
        return None
    return interval_us * 1000 if interval_us > 0 and pid == os.getpid() else None
