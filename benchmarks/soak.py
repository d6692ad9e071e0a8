"""Memory over a long run: a daemon at 100 times its speed, with clients that come, work and go.

    python benchmarks/soak.py [--seconds 60] [--speed 100]

Prints the resident memory once in a while, and its slope over the second half of the run, in KiB
for each hour of the PLC's time and for each 1,000 connections. Each look reloads the program.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pymodbus.client import ModbusTcpClient

from plcemu.runtime.control import ask

PROGRAM = """PROGRAM MAIN
VAR RETAIN n : UDINT; END_VAR
VAR t : TON; out AT %QW0 : UINT; seen AT %MW0 : UINT; END_VAR
  n := n + seen; t(IN := NOT t.Q, PT := T#1s); out := UDINT_TO_UINT(n);
END_PROGRAM
"""
CONFIG = """program: main.st
cycle: 100ms
speed: {speed}
modbus: {{port: 0}}
retain: {{file: kept, interval: 100ms}}
control: {{socket: s}}
"""


def resident_kib(pid: int) -> int:
    """Return the resident memory of a process, in KiB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1])


def client_life(port: int) -> None:
    """Connect, write and read some, disconnect."""
    client = ModbusTcpClient("127.0.0.1", port=port)
    client.connect()
    for _ in range(5):
        client.write_register(1024, random.randrange(100))
        client.read_holding_registers(0, count=10)
    client.close()


def slope(points: list[tuple[float, int]]) -> float:
    """Return the least-squares slope of y over x."""
    mean_x = sum(x for x, _ in points) / len(points)
    mean_y = sum(y for _, y in points) / len(points)
    spread = sum((x - mean_x) ** 2 for x, _ in points)
    return sum((x - mean_x) * (y - mean_y) for x, y in points) / spread if spread else 0.0


def main() -> None:
    """Run the soak and print what it found."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--speed", type=int, default=100)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "main.st").write_text(PROGRAM)
        (folder / "config.yaml").write_text(CONFIG.format(speed=arguments.speed))
        daemon = subprocess.Popen([sys.executable, "-m", "plcemu", "run", name, "--no-live"],
                                  stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        try:
            soak(folder, daemon.pid, arguments.seconds)
        finally:
            daemon.terminate()
            daemon.wait(30)


def soak(folder: Path, pid: int, seconds: float) -> None:
    """Let clients come and go, reload now and then, and watch the memory."""
    while not (folder / "s").exists():
        time.sleep(0.1)
    port = ask(folder / "s", {"command": "status"})["modbus"]["port"]
    begin, lives, points = time.monotonic(), 0, []
    next_look = 0.0
    while (elapsed := time.monotonic() - begin) < seconds:
        client_life(port)
        lives += 1
        if elapsed >= next_look:
            next_look += seconds / 20
            ask(folder / "s", {"command": "reload"})
            status = ask(folder / "s", {"command": "status"})
            points.append((status["t_s"] / 3600, lives, resident_kib(pid)))
            print(f"{elapsed:6.1f} s  {status['t_s'] / 3600:7.3f} h of the PLC  {lives:6d} clients"
                  f"  {status['changes']:3d} changes  {points[-1][2]:8d} KiB", flush=True)
    late = points[len(points) // 2:]
    print(f"slope of the second half: {slope([(h, kib) for h, _, kib in late]):+.0f} KiB an hour, "
          f"{1000 * slope([(n, kib) for _, n, kib in late]):+.0f} KiB a thousand clients")


if __name__ == "__main__":
    main()
