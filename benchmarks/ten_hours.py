"""Ten hours of the batch plant in virtual time, monitors on, beside the bare scans of its laps.

`python benchmarks/ten_hours.py [--json]`. CPU time of this process; imports and compiling are not
counted. Monitors: with them less without them. The peer only scans, as often as there were laps.

Nearly every lap brings a reading that changed by one resolution (0.1 l, 1 degC), which the program
and a property read; so no lap can be left out, and the figure is what such a lap costs
(docs/decisions.md, "A lap pays for what changed").
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

from plcemu.runtime.config import load_config
from plcemu.runtime.system import System

FOLDER = Path(__file__).parents[1] / "il_programs" / "batch_plant"
TEN_HOURS_NS = 36_000 * 10**9


def cpu_s(work: Callable[[], object]) -> float:
    """Return the CPU seconds that a piece of work takes."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def run(*settings: str) -> tuple[float, System]:
    """Run ten hours, and return the CPU seconds with the system as it then stands."""
    system = System(load_config(FOLDER, settings))
    return cpu_s(lambda: system.cycle.run_virtual(TEN_HOURS_NS)), system


def bare_scans(count: int) -> float:
    """Return the CPU seconds of scans alone, one cycle apart."""
    resource = System(load_config(FOLDER), with_plant=False).resource
    step = resource.first_release_ns(1)
    return cpu_s(lambda: [resource.scan(n * step) for n in range(count)])


def measure(rounds: int = 3) -> dict[str, float]:
    """Return the best of some rounds of each."""
    whole, unwatched, scans = [], [], []
    for _ in range(rounds):
        taken, system = run()
        laps = system.cycle.counters.laps
        whole.append(taken)
        unwatched.append(run("properties=[]")[0])
        scans.append(bare_scans(laps))
    total = min(whole)
    return {"cpu_s": total, "laps": laps, "us_per_lap": total / laps * 1e6,
            "monitors_share": 1 - min(unwatched) / total, "scans_cpu_s": min(scans),
            "scans_share": min(scans) / total, "times_bare_scans": total / min(scans)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    asked = parser.parse_args()
    found = {key: round(value, 4) for key, value in measure().items()}
    if asked.json:
        print(json.dumps(found))
        return
    for key, value in found.items():
        print(f"{key:>18} {value:g}")


if __name__ == "__main__":
    main()
