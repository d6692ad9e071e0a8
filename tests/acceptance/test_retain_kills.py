"""Retained variables survive SIGKILL at any instant: 200 daemons are killed under load."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from daemons import Registers, forked, free_port
from processes import PATIENCE_S

from plcemu.base.errors import PlcemuError
from plcemu.io.retain import Commit, RetainFile
from plcemu.runtime.control import ask

pytestmark = pytest.mark.acceptance

KILLS, LANES = 200, 4
WORDS = 600

PROGRAM = f"""PROGRAM MAIN
VAR RETAIN n : ULINT; words : ARRAY[1..{WORDS}] OF ULINT; inverse : LWORD; client : ULINT; END_VAR
VAR i : INT; written AT %ML0 : ULINT; shown AT %ML1 : ULINT; kept AT %ML2 : ULINT; END_VAR
  n := n + 1;
  FOR i := 1 TO {WORDS} DO words[i] := n; END_FOR;
  inverse := NOT ULINT_TO_LWORD(n);
  IF written > client THEN client := written; END_IF;
  shown := n; kept := client;
END_PROGRAM
"""
WRITTEN, SHOWN, KEPT = 4096, 4100, 4104
"""Holding registers of %ML0, %ML1 and %ML2."""


@dataclass
class Seen:
    """What clients were told while the daemon lived."""

    announced: int = 0
    states: list[tuple[int, int, int]] = field(default_factory=list)

    def promised(self) -> tuple[int, int]:
        """Return the newest counters that must be on the disk.

        A commit that begins after a state was seen holds that state or a later one; the second
        commit announced after it did begin after it.
        """
        return max(((n, client) for n, client, before in self.states
                    if before + 2 <= self.announced), default=(0, 0))


class Lane:
    """One configuration, whose daemons live one after another."""

    def __init__(self, folder: Path, seed: int) -> None:
        folder.mkdir()
        self.folder, self.random, self.port = folder, random.Random(seed), free_port()
        (folder / "main.st").write_text(PROGRAM)
        (folder / "config.yaml").write_text(
            f"program: main.st\ncycle: 5ms\nmodbus: {{port: {self.port}}}\n"
            "retain: {file: kept, interval: 10ms}\ncontrol: {socket: s}\n")
        self.sent = 0
        self.last: dict[str, int] = {"n": 0, "client": 0, "sequence": 0}
        self.lives_with_commits = 0

    def live_and_die(self) -> None:
        """Let a daemon live until it is killed: while it starts, or at work under load."""
        seen = Seen()
        with forked([str(self.folder)], self.folder / "log") as daemon:
            if self.random.random() < 0.2:
                time.sleep(self.random.uniform(0, 0.2))
            else:
                self._use(daemon.kill, seen)
        self._judge(seen)

    def _use(self, kill: Callable[[], None], seen: Seen) -> None:
        """Write and read until the daemon dies, a while after its first commit."""
        patience = time.monotonic() + PATIENCE_S
        with Registers(self.port, patience) as plc:
            timer = threading.Timer(self.random.uniform(0, 0.1), kill)
            with suppress(OSError, PlcemuError):  # it died under us
                while seen.announced <= self.last["sequence"]:
                    self._one_look(plc, seen)
                    assert time.monotonic() < patience, "no commit was announced"
                timer.start()
                while True:
                    self._one_look(plc, seen)
            timer.join()

    def _one_look(self, plc: Registers, seen: Seen) -> None:
        self.sent += 1
        plc.write_long(WRITTEN, self.sent)
        n, client = plc.read_long(SHOWN), plc.read_long(KEPT)
        # A state of this run is never older than what the file held before.
        assert n == 0 or n > self.last["n"]
        commits = ask(self.folder / "s", {"command": "get", "name": "retain.commits"})["value"]
        seen.states.append((n, client, commits))
        seen.announced = max(seen.announced, commits)

    def _judge(self, seen: Seen) -> None:
        """The file holds one whole commit, and everything that was promised."""
        found = RetainFile(self.folder / "kept").read()
        if found.is_first:
            assert seen.announced == 0
            return
        assert found.commit is not None, found.problems
        values = whole_values(found.commit)
        n, client = seen.promised()
        assert values["n"] >= max(n, self.last["n"])
        assert values["client"] >= max(client, self.last["client"])
        assert values["sequence"] >= max(seen.announced, self.last["sequence"])
        self.lives_with_commits += values["sequence"] > self.last["sequence"]
        self.last = values


def whole_values(commit: Commit) -> dict[str, int]:
    """Return the counters of a commit in which all words fit together."""
    found = {v.name: commit.data[v.offset:v.offset + v.size] for v in commit.variables()}
    n = int.from_bytes(found["MAIN.n"], "little")
    assert found["MAIN.words"] == found["MAIN.n"] * WORDS
    assert int.from_bytes(found["MAIN.inverse"], "little") == n ^ (1 << 64) - 1
    return {"n": n, "client": int.from_bytes(found["MAIN.client"], "little"),
            "sequence": commit.sequence}


def test_no_commit_is_torn_or_lost_in_200_kills(tmp_path: Path) -> None:
    lanes = [Lane(tmp_path / str(n), seed=n) for n in range(LANES)]

    def lives(lane: Lane) -> None:
        for _ in range(KILLS // LANES):
            lane.live_and_die()

    with ThreadPoolExecutor(LANES) as pool:
        for done in [pool.submit(lives, lane) for lane in lanes]:
            done.result()
    logs = [(lane.folder / "log").read_text() for lane in lanes]
    assert not any("Traceback" in log or "ERROR" in log for log in logs)
    assert sum(lane.lives_with_commits for lane in lanes) > KILLS // 2
    assert all("warm start" in log for log in logs)
