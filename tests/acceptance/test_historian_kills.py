"""The historian's file survives SIGKILL at any instant: every committed frame is whole."""

from __future__ import annotations

import random
import sqlite3
import time
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest
from daemons import forked
from processes import until

from plcemu.base import historyfile
from plcemu.base.tracefile import load

pytestmark = pytest.mark.acceptance

KILLS = 12
CONFIG = """name: killed
program: main.st
cycle: 1ms
modbus: {enabled: false}
control: {enabled: false}
historian: {file: history.sqlite, tags: ["MAIN.*"], interval: 5ms}
"""
PROGRAM = """PROGRAM MAIN
VAR n : DINT; twice : DINT; inverse : DINT; END_VAR
  n := n + 1; twice := 2 * n; inverse := -n;
END_PROGRAM
"""


def frames_in(path: Path) -> int:
    return sum(run.frames for run in historyfile.runs(path)) if path.exists() else 0


def test_a_killed_historian_leaves_whole_frames(tmp_path):
    (tmp_path / "config.yaml").write_text(CONFIG)
    (tmp_path / "main.st").write_text(PROGRAM)
    path, chance = tmp_path / "history.sqlite", random.Random(20260728)
    for n in range(KILLS):
        before = frames_in(path)
        with forked([str(tmp_path), "--no-live"], tmp_path / "log") as daemon:
            until(lambda before=before: path.exists() and path.stat().st_size > 0
                  and frames_in(path) > before, "the historian commits")
            time.sleep(chance.uniform(0, 0.05))
            daemon.kill()
            daemon.join()
        with closing(sqlite3.connect(path)) as base:
            assert base.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        trace = load(path)
        assert len(historyfile.runs(path)) == n + 1
        states = [dict(state) for _, state in trace.values()]
        assert all(s[1] == 2 * s[0] and s[2] == -s[0] for s in states)
        assert all(b[0] == a[0] + 1 for a, b in pairwise(states))
