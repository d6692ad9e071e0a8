"""Our checker beside SPIN's whole chain on the 30 loads of the batch plant, in one run.

Both decide property (1) of the paper, and the invariants without durations, from each of the 30
loads; what our checker needs for all properties, also those of LTL that SPIN is not asked, is told
besides. Ours is the whole command `plcemu verify`: the interpreter's start, compiling the program,
exploring, judging. SPIN's is `spin -a`, gcc -O2, and pan once for each load (more often after an
error), on the model that `plcemu verify --promela` writes; making that model is not counted. One
compiled model serves all loads; with `--each` every load is besides given a model of its own, as a
user of SPIN would without a parameter. Seconds are of the processor and, in brackets, by the
clock; trails that SPIN prints (pan -r) are not counted.

    python benchmarks/spin_speed.py [--each]
"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

from plant_sim.batch_plant.abstraction import initial_loads
from plcemu.runtime.config import load_config
from plcemu.runtime.second_opinion import Opinion, ask_spin
from plcemu.runtime.verification import make_prover
from plcemu.verify.prove import NO_FAULT

BATCH = Path(__file__).parents[1] / "il_programs" / "batch_plant"
CHAIN = ("spin", "compiler", "pan")


def ours(*options: str) -> tuple[float, float]:
    """Return what `plcemu verify` takes as a command, of the processor and by the clock."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([sys.executable, "-m", "plcemu", "verify", str(BATCH), "--json", *options],
                   stdout=subprocess.DEVNULL, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            time.monotonic() - begin)


def spins(*overrides: str) -> Opinion:
    """Return SPIN's opinion, with what it took."""
    config = load_config(BATCH, overrides)
    prover = make_prover(config, recorded=True)
    return ask_spin(prover, prover.prove(), config.name)


def chain(opinions: list[Opinion]) -> tuple[float, float]:
    """Print what SPIN's chain took, part by part; return the sums."""
    for part in CHAIN:
        print(f"  {part:<10} {sum(o.costs.seconds.get(part, 0) for o in opinions):>8.2f} s "
              f"({sum(o.costs.wall.get(part, 0) for o in opinions):.2f} s)")
    states, transitions = (sum(getattr(o.costs, n) for o in opinions)
                           for n in ("states", "transitions"))
    pan = sum(o.costs.seconds["pan"] for o in opinions)
    print(f"  {states:,} states stored, {transitions:,} transitions, {states / pan:,.0f} states/s, "
          f"{transitions / pan:,.0f} transitions/s in pan")
    return (sum(o.costs.seconds.get(p, 0) for o in opinions for p in CHAIN),
            sum(o.costs.wall.get(p, 0) for o in opinions for p in CHAIN))


def report(name: str, took: tuple[float, float]) -> None:
    """Print a sum."""
    print(f"{name:<44} {took[0]:>8.2f} s ({took[1]:.2f} s)")


def ratio(one: tuple[float, float], other: tuple[float, float]) -> None:
    """Print how one compares with the other."""
    print(f"  ours / SPIN's: {one[0] / other[0]:.2f} of the processor, {one[1] / other[1]:.2f} by "
          "the clock")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", action="store_true", help="also one model for each load")
    each = parser.parse_args().each
    whole = ours("--set", "initial=loads")
    report("plcemu verify, all loads and properties", whole)
    missing = [name for name in ("spin", "gcc") if shutil.which(name) is None]
    if missing:
        print(f"no comparison: {' and '.join(missing)} not installed (apt install spin gcc "
              "libc6-dev)")
        return
    opinion = spins("initial=loads")
    print("SPIN, one model for all loads:")
    told = chain([opinion])
    report("SPIN's chain, one model", told)
    asked = {r.name for r in opinion.rows if r.asked} - {NO_FAULT}
    same = ours("--set", "initial=loads",
                *(option for name in sorted(asked) for option in ("--property", name)))
    report("plcemu verify, all loads, the same questions", same)
    ratio(same, told)
    verdicts = Counter(r.answer.verdict for r in opinion.rows if r.name == "produces")
    print(f"  property (1): {dict(verdicts)}; {len(opinion.differs)} verdicts differ")
    if each:
        _each()


def _each() -> None:
    """Measure one model for each load."""
    opinions, sums = [], (0.0, 0.0)
    for _, tanks in initial_loads():
        held = ", ".join(f"{tank}={word}" for tank, word in tanks.items()) or "B1=empty"
        override = f"tanks={held}"
        took = ours("--set", override)
        sums = sums[0] + took[0], sums[1] + took[1]
        opinions.append(spins(override))
    report("plcemu verify, 30 runs of one load", sums)
    print("SPIN, a model for each load:")
    told = chain(opinions)
    report("SPIN's chain, 30 models", told)
    ratio(sums, told)


if __name__ == "__main__":
    main()
