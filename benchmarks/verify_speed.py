"""Proofs and schedules of the batch plant: states and scans a second, and the time to each proof.

The same loads with both engines (the interpreter is the readable one), then all 8100 initial
configurations, then the least periods of all loads with their checked certificates. Seconds are of
the processor, since other work on the machine only adds.

    python benchmarks/verify_speed.py [--quick]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from plcemu.runtime.config import load_config
from plcemu.runtime.scheduling import Scheduler
from plcemu.runtime.verification import make_prover
from plcemu.verify.certificate import flaw_in
from plcemu.verify.explore import used_mb
from plcemu.verify.schedule import TimedGraph, least_period

BATCH = Path(__file__).parents[1] / "il_programs" / "batch_plant"


def prove(initial: str, engine: str) -> None:
    """Prove all properties and print what it took."""
    prover = make_prover(load_config(BATCH, [f"initial={initial}", f"engine={engine}"]))
    begin = time.process_time()
    result = prover.prove()
    seconds = time.process_time() - begin
    graph = result.graph
    print(f"{initial:>8}  {engine:<12} {len(graph):>8,} states {graph.edges:>8,} transitions "
          f"{result.scans:>9,} scans {seconds:>7.2f} s {len(graph) / seconds:>9,.0f} states/s "
          f"{result.scans / seconds:>9,.0f} scans/s")


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
    for engine in ("interpreter", "wasm"):
        prove("load", engine)
    if not quick:
        prove("loads", "wasm")
        prove("all", "wasm")
    schedule()


if __name__ == "__main__":
    main()
