"""Proofs and schedules of the batch plant: states and scans a second, and the time to each proof.

One load in the readable ways, one scan after the other with both engines, beside many at once; then
the 30 loads in both ways on the fast engine, and all 8100 initial configurations. Scans are those
that the engine executed, none remembered; the rate is that of the exploration, with the finite
plant and all bookkeeping. Then `plcemu verify` for the 30 loads as a command, from its start to its
end with the judgement of every property, and the least periods of all loads with their checked
certificates. Seconds are of the processor, since other work on the machine only adds; where
it shares the processor's caches, it still slows everything down, so compare within a run.

    python benchmarks/verify_speed.py [--quick]
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path

from plcemu.runtime.config import load_config
from plcemu.runtime.scheduling import Scheduler
from plcemu.runtime.verification import make_prover
from plcemu.verify.explore import explore, used_mb
from plcemu.verify.schedules.certificate import flaw_in
from plcemu.verify.schedules.schedule import TimedGraph, least_period

BATCH = Path(__file__).parents[1] / "il_programs" / "batch_plant"


def find_all(initial: str, engine: str, together: bool, beside: float = 0.0) -> float:
    """Explore all states; print what it took, beside the readable way, and return it."""
    config = load_config(BATCH, [f"initial={initial}", f"engine={engine}"])
    begin = time.process_time()
    prover = make_prover(config, together=together)
    made = time.process_time()
    graph = explore(prover.loop)
    seconds = time.process_time() - made
    scans, way = prover.loop.machine.scans, "many at once" if together else "one by one"
    ratio = f" {beside / seconds:>6.1f} times as fast" if beside else ""
    print(f"{initial:>6}  {engine:<11} {way:<12} {len(graph):>7,} states {graph.edges:>7,} "
          f"transitions {scans:>8,} scans, made in {made - begin:.2f} s, explored in "
          f"{seconds:>5.2f} s: {scans / seconds:>8,.0f} scans/s{ratio}")
    return seconds


def command() -> None:
    """Run `plcemu verify` for all loads as a command, and print what it took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "plcemu.cli.main", "verify", str(BATCH),
                    "--set", "initial=loads"], check=False, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"plcemu verify, all loads, start to end: {seconds:.2f} s")


def schedule() -> None:
    """Prove the least period of every load, and print what it took."""
    scheduler = Scheduler(load_config(BATCH))
    whole = 0.0
    for case in scheduler.cases("all"):
        begin = time.process_time()
        protocol = scheduler.scheduling.protocol(case)
        graph = TimedGraph(protocol)
        found = least_period(graph)
        proof = "none" if found is None else flaw_in(found, protocol) or "checked"
        seconds = time.process_time() - begin
        whole += seconds if "half" not in case.keys else 0
        period = f"{float(found.period * protocol.unit_s):g} s" if found else "-"
        print(f"{case.name:<26} {period:>7}  proof {proof:<8} {len(graph.states):>7,} states "
              f"{seconds:>6.2f} s")
    print(f"all whole loads: {whole:.2f} s; the process has needed {used_mb()} MB at most")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one load instead of all")
    quick = parser.parse_args().quick
    slow = find_all("load", "interpreter", False)
    find_all("load", "wasm", False, slow)
    find_all("load", "wasm", True, slow)
    if not quick:
        slow = find_all("loads", "wasm", False)
        find_all("loads", "wasm", True, slow)
        find_all("all", "wasm", True)
        command()
    schedule()


if __name__ == "__main__":
    main()
