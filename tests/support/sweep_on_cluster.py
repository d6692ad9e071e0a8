"""A sweep on a Dask cluster that tells of every result as it comes: FOLDER ADDRESS RUNS."""

from __future__ import annotations

import json
import sys

from plcemu.runtime.config import ConfigText
from plcemu.runtime.sweep import Design, make_plan
from plcemu.runtime.workers import run_on_cluster

if __name__ == "__main__":
    folder, address, runs = sys.argv[1:]
    design = Design((), int(runs), seed=5)
    plan = make_plan(ConfigText.read(folder), (), 600_000_000, design, ["plant.stop_mm"])
    results = []
    for finished in run_on_cluster(plan, design, address):
        results += [each.as_json() for each in finished]
        print(f"finished {len(results)}", file=sys.stderr, flush=True)
    json.dump(sorted(results, key=lambda r: r["run"]), sys.stdout)
