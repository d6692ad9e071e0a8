"""Period jitter and missed releases of the daemon beside a C program with clock_nanosleep.

Both scan the same 200 boolean rungs at 1 ms and at 10 ms, idle and while a client in another
process floods a Modbus server: four connections, each with 16 requests for 125 registers under way.
The daemon serves that client itself; beside the C program a second daemon does, so that the machine
is as busy. Slices of both alternate within the same minute, since neighbours on the machine matter
more than the design. Both ask for 1 ns of timer slack, with --fifo for SCHED_FIFO too.

Jitter is the change of the lateness from one scan to the next; a release is missed when the scan
before it ended after it, and is skipped. Times are in microseconds.

    python benchmarks/jitter.py [--rounds N] [--seconds S] [--fifo] [--periods 1 10]
        [--realtime "reserve: 500us"]
"""

from __future__ import annotations

import argparse
import array
import asyncio
import contextlib
import os
import selectors
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

RUNGS = 200
CONNECTIONS, PIPELINE = 4, 16
PATIENCE_S = 60.0
WARM_UP = 50
"""Scans at the beginning of a slice that are not counted: caches are cold and processes start."""

C_PROGRAM = r"""
#define _GNU_SOURCE
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>
static volatile uint8_t x[%(rungs)d + 2];
static void scan(void) {
    for (int i = 0; i < %(rungs)d; i++) x[i] = (x[i + 1] & x[(i + 7) %% %(rungs)d]) | !x[i + 2];
}
static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}
int main(int argc, char **argv) {
    int64_t period = atoll(argv[1]), total = atoll(argv[2]), n = 0;
    prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
    if (atoi(argv[3])) {
        struct sched_param p = {.sched_priority = 20};
        sched_setscheduler(0, SCHED_FIFO, &p);
    }
    int64_t *late = malloc((total / period + 2) * 16);
    int64_t start = now() + period, release = start;
    while (release < start + total) {
        struct timespec t = {release / 1000000000, release %% 1000000000};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, 0);
        int64_t begin = now();
        scan();
        int64_t end = now(), next = release + period, missed = 0;
        if (end > next) missed = (end - next + period - 1) / period;
        late[2 * n] = begin - release;
        late[2 * n++ + 1] = missed;
        release = next + missed * period;
    }
    fwrite(late, 16, n, stdout);
    return 0;
}
"""


class Slice(NamedTuple):
    """One measurement: lateness of each scan in ns, and releases missed after it."""

    late_ns: Sequence[int]
    missed: Sequence[int]

    @classmethod
    def parse(cls, data: bytes) -> Slice:
        """Read pairs of 64-bit integers; the first scans are left out."""
        pairs = array.array("q", data)
        return cls(pairs[2 * WARM_UP::2], pairs[2 * WARM_UP + 1::2])

    def jitter_ns(self) -> list[int]:
        """Return by how much each period differed from a whole number of periods."""
        return [abs(b - a) for a, b in zip(self.late_ns, self.late_ns[1:], strict=False)]


# ---------------------------------------------------------------- the daemon


def be_daemon(period_ns: int, total_ns: int, fifo: bool, options: str) -> None:
    """Run the daemon as `plcemu run` does; tell its port, then every scan's lateness."""
    from plcemu.runtime.config import load_config
    from plcemu.runtime.daemon import Daemon
    from plcemu.runtime.system import System

    names = [f"x{n}" for n in range(RUNGS + 2)]
    rungs = "".join(f"LD x{n + 1}\nAND x{(n + 7) % RUNGS}\nORN x{n + 2}\nST x{n}\n"
                    for n in range(RUNGS))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        (path / "main.il").write_text(f"PROGRAM MAIN\nVAR {', '.join(names)} : BOOL; END_VAR\n"
                                      f"{rungs}END_PROGRAM\n")
        (path / "config.yaml").write_text(
            f"program: main.il\ncycle: {period_ns}ns\nmodbus: {{port: 0}}\n"
            f"realtime: {{scheduler: {'fifo' if fifo else 'other'}, {options}}}\n")
        system = System(load_config(path))
    daemon = Daemon(system, total_ns)
    pairs, told = array.array("q"), 0
    counters = system.cycle.counters

    def on_lap() -> None:
        nonlocal told
        if not pairs:
            assert daemon.server is not None
            print(daemon.server.port, flush=True)
        pairs.extend((counters.late_ns, counters.missed - told))
        told = counters.missed

    asyncio.run(daemon.run(on_lap))
    sys.stdout.buffer.write(pairs.tobytes())


def start_daemon(period_ns: int, total_ns: int, fifo: bool, options: str) -> tuple[
        subprocess.Popen[bytes], int]:
    """Start a daemon; return it and its port once it scans."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--daemon", str(period_ns), str(total_ns), str(int(fifo)),
         options],
        stdout=subprocess.PIPE)
    assert process.stdout is not None
    return process, int(process.stdout.readline())


# ---------------------------------------------------------------- the load


def be_client(port: int) -> None:
    """Flood a server until it closes or this process is ended."""
    pdu = struct.pack(">BHH", 3, 0, 125)
    request = struct.pack(">HHHB", 1, 0, len(pdu) + 1, 1) + pdu
    answer_bytes = 7 + 2 + 250
    chooser = selectors.DefaultSelector()
    for _ in range(CONNECTIONS):
        peer = socket.create_connection(("127.0.0.1", port))
        peer.sendall(request * PIPELINE)
        chooser.register(peer, selectors.EVENT_READ, [0])
    count = 0
    with contextlib.suppress(ConnectionError):
        while True:
            for key, _ in chooser.select():
                data = key.fileobj.recv(65536)  # type: ignore[union-attr]
                if not data:
                    return
                key.data[0] += len(data)
                done, key.data[0] = divmod(key.data[0], answer_bytes)
                count += done
                key.fileobj.sendall(request * done)  # type: ignore[union-attr]


@contextlib.contextmanager
def load(port: int | None) -> Iterator[None]:
    """Keep a client at work on a server; None for no client."""
    if port is None:
        yield
        return
    client = subprocess.Popen([sys.executable, __file__, "--client", str(port)])
    try:
        yield
    finally:
        client.kill()
        client.wait()


# ---------------------------------------------------------------- measuring


def measure_daemon(period_ns: int, seconds: float, loaded: bool, fifo: bool, options: str) -> Slice:
    """Measure one slice of the daemon."""
    daemon, port = start_daemon(period_ns, int(seconds * 1e9), fifo, options)
    with load(port if loaded else None):
        data, _ = daemon.communicate(timeout=seconds + PATIENCE_S)
    return Slice.parse(data)


def measure_c(program: Path, period_ns: int, seconds: float, loaded: bool, fifo: bool) -> Slice:
    """Measure one slice of the C program, while another daemon serves the load."""
    server, port = None, None
    if loaded:
        server, port = start_daemon(10_000_000, int((seconds + 30) * 1e9), False, "")
    try:
        with load(port):
            time.sleep(0.3 if loaded else 0.0)
            data = subprocess.run([program, str(period_ns), str(int(seconds * 1e9)),
                                   str(int(fifo))], capture_output=True, check=True,
                                  timeout=seconds + PATIENCE_S).stdout
    finally:
        if server is not None:
            server.kill()
            server.communicate()
    return Slice.parse(data)


def build(folder: str) -> Path:
    """Compile the C program."""
    source = Path(folder) / "cycle.c"
    source.write_text(C_PROGRAM % {"rungs": RUNGS})
    program = Path(folder) / "cycle"
    subprocess.run(["gcc", "-O2", "-o", program, source], check=True)
    return program


def percentile(values: Sequence[int], share: float) -> float:
    """Return the value below which a share of the values lies, in us."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))] / 1000


def row(name: str, slices: Sequence[Slice]) -> float:
    """Print the figures of one design over its slices; return the share of missed releases."""
    jitter = [j for s in slices for j in s.jitter_ns()]
    late = [n for s in slices for n in s.late_ns]
    shares = [sum(s.missed) / (len(s.missed) + sum(s.missed)) for s in slices]
    missed = sum(sum(s.missed) for s in slices)
    share = missed / (len(late) + missed)
    print(f"{name:22}{percentile(jitter, .5):>9.0f}{percentile(jitter, .99):>9.0f}"
          f"{max(jitter) / 1000:>9.0f}{percentile(late, .5):>9.0f}{percentile(late, .99):>9.0f}"
          f"{100 * share:>9.2f}   {100 * min(shares):.2f} .. {100 * max(shares):.2f}")
    return share


def compare(rounds: int, seconds: float, fifo: bool, options: str,
            periods_ms: Sequence[int]) -> None:
    """Print a table for each period and load."""
    with tempfile.TemporaryDirectory() as folder:
        program = build(folder)
        for period_ms in periods_ms:
            for loaded in (False, True):
                period_ns = period_ms * 1_000_000
                ours, theirs = [], []
                for _ in range(rounds):
                    ours.append(measure_daemon(period_ns, seconds, loaded, fifo, options))
                    theirs.append(measure_c(program, period_ns, seconds, loaded, fifo))
                print(f"\n{period_ms} ms, {'Modbus flood' if loaded else 'idle'}"
                      f"{', SCHED_FIFO' if fifo else ''}"
                      f"\n{'':22}{'J p50':>9}{'J p99':>9}{'J max':>9}{'late p50':>9}"
                      f"{'late p99':>9}{'missed %':>9}   by slice")
                mine, c = row("plcemu", ours), row("C, clock_nanosleep", theirs)
                print(f"missed, plcemu : C = {mine / c:.2f}" if c else "C missed none", flush=True)
    print(f"\n{rounds} slices of {seconds:g} s each, alternating; {os.cpu_count()} CPUs, load "
          f"average {os.getloadavg()[0]:.1f}, Python {sys.version.split()[0]}")


def main() -> None:
    """Read the arguments and compare, or be one of the processes."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--fifo", action="store_true", help="SCHED_FIFO for both; needs rights")
    parser.add_argument("--periods", type=int, nargs="+", default=(1, 10), help="in ms")
    parser.add_argument("--realtime", default="", help="more of the daemon's section realtime")
    parser.add_argument("--daemon", nargs=4, help=argparse.SUPPRESS)
    parser.add_argument("--client", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.daemon:
        period, total, fifo, options = arguments.daemon
        be_daemon(int(period), int(total), fifo == "1", options)
    elif arguments.client:
        be_client(arguments.client)
    elif shutil.which("gcc") is None:
        print("gcc is not installed: there is nothing to compare with")
    else:
        compare(arguments.rounds, arguments.seconds, arguments.fifo, arguments.realtime,
                arguments.periods)


if __name__ == "__main__":
    main()
