"""Exact reachability: the whole of the conveyor's Figure 7 in 10 us steps, and zones beside polyhedra.

The paper needed hundreds of runs of up to 5 minutes for the figure, at a coarser step. The peer is
the general form of regions, exact polyhedra, on a few of the same values.

    python benchmarks/reach_speed.py [--step 10us] [--jobs 2] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

from plcemu.runtime.config import ConfigText
from plcemu.runtime.reach import Found, study
from plcemu.runtime.variation import parse_variation

CONVEYOR = Path(__file__).parents[1] / "il_programs" / "conveyor"
FEW = "cycle=30ms..60ms:10ms"
"""Long cycles: few states, so that polyhedra have a chance."""


def timed(vary: str, overrides: list[str], jobs: int) -> tuple[float, list[Found]]:
    """Return the seconds by the wall and the answers."""
    begin = time.perf_counter()
    answers = study(ConfigText.read(CONVEYOR), overrides, parse_variation(vary), jobs=jobs)
    return time.perf_counter() - begin, answers


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--step", default="10us", help="of the cycle time (10us)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    whole, answers = timed(f"cycle=1ms..15ms:{arguments.step}", [], arguments.jobs)
    zones, quick = timed(FEW, [], 1)
    polyhedra, general = timed(FEW, ["reach.regions=polyhedra"], 1)
    found = {"figure7_s": whole, "values": len(answers), "jobs": arguments.jobs,
             "states": sum(a.states for a in answers),
             "conclusive": all(a.conclusive for a in answers),
             "polyhedra_over_zones": polyhedra / zones,
             "agree": [a.pieces for a in quick] == [a.pieces for a in general]}
    if arguments.json:
        print(json.dumps(found, indent=2))
        return
    print(f"figure 7, {len(answers)} values, {found['states']:,} symbolic states, "
          f"{arguments.jobs} processes: {whole:.2f} s, "
          f"{'all' if found['conclusive'] else 'NOT ALL'} conclusive")
    print(f"{len(quick)} values: zones {zones:.3f} s, polyhedra {polyhedra:.3f} s "
          f"({polyhedra / zones:.0f} times), they {'agree' if found['agree'] else 'DIFFER'}")


if __name__ == "__main__":
    main()
