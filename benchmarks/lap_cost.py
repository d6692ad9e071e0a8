"""What a lap of the daemon costs for a program with 1,000 tags, beside the bare scan.

    python benchmarks/lap_cost.py [--tags N] [--changing N]

A lap is all that the loop does between two sleeps: latch, scan with its statistics, publish, frame,
observers that are idle. It is measured as the loop calls it, with a real clock; the peer in the
same run is the bare call of the task's code. The best of several rounds is told.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable

from plcemu.base.trace import Frame
from plcemu.engine.resource import Resource
from plcemu.lang.compile import compile_program
from plcemu.runtime.clock import RealClock
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.plc import make_exchange

LAPS, ROUNDS = 20, 500


class Idle:
    """An observer that only looks whether there is something."""

    def observe(self, frame: Frame) -> None:
        pass


def program(tags: int, changing: int) -> str:
    """Return a program whose inputs, outputs and variables are so many tags; some always change."""
    count = tags // 4
    inputs = "".join(f"i{n} AT %IX{n // 8}.{n % 8} : BOOL; " for n in range(count))
    outputs = "".join(f"q{n} AT %QX{n // 8}.{n % 8} : BOOL; " for n in range(count))
    numbers = "".join(f"w{n} AT %QW{n} : INT; " for n in range(count // 2))
    inner = "".join(f"x{n} : BOOL; " for n in range(tags - 2 * count - count // 2))
    lines = "\n".join([*(f"LD i{n}\nANDN x{n}\nST q{n}" for n in range(count)),
                       *(f"LD w{n}\nADD 1\nST w{n}" for n in range(changing))])
    return f"PROGRAM MAIN VAR {inputs}{outputs}{numbers}{inner}END_VAR\n{lines}\nEND_PROGRAM\n"


def best_us(run: Callable[[], object]) -> float:
    """Return the least time of a call over the rounds, in µs."""
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter_ns()
        for _ in range(LAPS):
            run()
        times.append((time.perf_counter_ns() - begin) / LAPS)
    return min(times) / 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tags", type=int, default=1000, help="tags of the program")
    parser.add_argument("--changing", type=int, default=10, help="tags that change in every lap")
    arguments = parser.parse_args()
    compiled = compile_program(program(arguments.tags, arguments.changing))
    resource = Resource(compiled, 10_000_000)
    cycle = Cycle(resource, make_exchange(resource))
    cycle.observers.append(Idle())
    instances = [compiled.instance(name) for name in resource.tasks[0].programs]
    code = resource.engine.prepare([(i.function, i.base) for i in instances])
    gc.collect()
    gc.freeze()
    with RealClock() as clock:
        scan, lap = best_us(code.run), best_us(lambda: cycle.lap(clock.now_ns))
    print(f"{len(resource.memory.tags)} tags, {len(resource.memory.block)} bytes, "
          f"{arguments.changing} tags change, engine {resource.engine.name}")
    print(f"scan {scan:8.2f} us\nlap  {lap:8.2f} us   {lap / scan:.1f} times the scan")


if __name__ == "__main__":
    main()
