"""Cost of monitors: properties of the papers over scans, and a long recording, beside two peers.

Three measurements, in CPU time of this process, of several rounds the fastest:

1. ten properties over an evaporator's run of 10 ms scans, fed as an online monitor gets them: a
   frame a scan, empty where nothing changed;
2. one response with a 22 s bound over the same scans;
3. a recording of a million changes (every change flips a tag that the formulas read or moves a
   level), judged offline.

The run repeats a cycle of 92 s with a condenser malfunction in every other one; the levels move
in each scan while a tank fills or drains, so that about one scan in ten has changes.

The peers judge what of it they can express: rtamt (pure Python, signal temporal logic) the response
without its outer "always", since it turns only bounded formulas into ones for online use, and a
recording in dense time; reelay (C++ with Python bindings, past operators only) the response said of
the past: the heater has not been on since a malfunction 22 s ago or longer. Each is given its
input ready made. Peers that are not installed are named and left out.

    pip install rtamt reelay
    python benchmarks/monitor_cost.py [--rounds N]
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from plcemu.base.tags import Tag, TagTable
from plcemu.base.time import NS_PER_S
from plcemu.base.trace import Frame, Trace
from plcemu.monitor import Suite, judge, parse_properties

SCAN_NS = 10_000_000
CYCLE = 9_200  # scans: 92 s
CYCLES = 10
TAGS = TagTable([*(Tag(name, "BOOL") for name in (
    "Malf", "H", "MR", "V1", "V3", "V4", "T1E", "T1F", "T2E", "Alarm", "X11", "overflow1",
    "overflow2", "explosion")), Tag("level1", "LREAL", "m"), Tag("level2", "LREAL", "m")])

RESPONSE = "PS1: G (Malf -> F[0s,22s] !`H`)\n"
TEN = RESPONSE + """
no_explosion: never explosion
no_overflow_1: never overflow1
no_overflow_2: never overflow2
V4_first: G (rise(V3) -> T2E)
mixed: `H` only while MR
alarm: G (X11 -> Alarm)
answered: Malf causes X11 within 100ms
heating: `H` lasts at most 21s
level: level1 stays within 0 to 1
"""


def evaporator(cycle: int) -> Iterator[tuple[int, dict[str, object]]]:
    """Yield (scan, changes) of one production cycle; every other one has a malfunction."""
    at = 0
    for n in range(67):
        yield at + n, {"level1": n / 67}
    yield at + 67, {"T1F": True, "T1E": False, "V1": False, "MR": True, "level1": 1.0}
    yield at + 267, {"H": True}
    if cycle % 2:
        yield at + 1500, {"Malf": True}
        yield at + 1501, {"X11": True, "Alarm": True, "H": False}
    else:
        yield at + 2267, {"H": False}
    yield at + 2268, {"V3": True}
    for n in range(226):
        yield at + 2269 + n, {"level1": 1 - n / 226, "level2": n / 226}
    yield at + 2269, {"T2E": False}
    yield at + 2495, {"T1E": True, "T1F": False, "MR": False, "V3": False}
    yield at + 5700, {"V4": True, "Malf": False, "X11": False, "Alarm": False}
    for n in range(600):
        yield at + 5701 + n, {"level2": 1 - n / 600}
    yield at + 6400, {"V4": False, "T2E": True, "V1": True}


def scans() -> list[Frame]:
    """Return a frame for every scan of the run."""
    first = {tag.name: tag.type == "BOOL" and tag.name in ("T1E", "T2E", "V1") for tag in TAGS}
    first |= {"level1": 0.0, "level2": 0.0}
    changes: dict[int, dict[str, object]] = {0: first}
    for cycle in range(CYCLES):
        for scan, change in evaporator(cycle):
            changes.setdefault(cycle * CYCLE + scan, {}).update(change)
    return [Frame(n * SCAN_NS, n, tuple((TAGS.find(k), v) for k, v in changes.get(n, {}).items()))
            for n in range(CYCLE * CYCLES)]


def timed(work: Callable[[], int], rounds: int) -> float:
    """Return how many a second the work does, by the fastest round; it returns how many."""
    best = 0.0
    for _ in range(rounds):
        begin = time.process_time()
        count = work()
        best = max(best, count / (time.process_time() - begin))
    return best


def ours_online(text: str, frames: Sequence[Frame]) -> int:
    """Judge scans as they come."""
    suite = Suite(parse_properties(text), TAGS)
    observe = suite.observe
    for frame in frames:
        observe(frame)
    assert not any(result.failed for result in suite.results())
    return len(frames)


def recording(events: int) -> Trace:
    """Return a long recording in which every frame changes something."""
    malf, heater, level = (TAGS.find(name) for name in ("Malf", "H", "level1"))
    first = tuple((i, False if tag.type == "BOOL" else 0.0) for i, tag in enumerate(TAGS))
    frames = [Frame(0, 0, first)]
    for n in range(1, events):
        phase = n % 10
        change = ((malf, phase == 2),) if phase in (2, 3) else \
            ((heater, phase == 5),) if phase in (5, 6) else ((level, n % 7 / 7),)
        frames.append(Frame(n * SCAN_NS, n, change))
    return Trace(TAGS, frames, events * SCAN_NS)


def ours_offline(trace: Trace, text: str) -> int:
    """Judge a recording."""
    assert not any(result.failed for result in judge(trace, parse_properties(text)))
    return len(trace.frames)


# ---------------------------------------------------------------- peers


def reelay_online(reelay: Any, rows: Sequence[dict[str, bool]]) -> int:
    """Judge the response, said of the past, scan by scan."""
    monitor = reelay.discrete_timed_monitor(
        pattern="not ({H} since[2200:] ({Malf} and {H}))", semantics="boolean", condense=False)
    update = monitor.update
    assert all(update(row)["value"] for row in rows)
    return len(rows)


def reelay_dense(reelay: Any, rows: Sequence[dict[str, object]]) -> int:
    """Judge the response, said of the past, change by change."""
    monitor = reelay.dense_timed_monitor(
        pattern="not ({H} since[22:] ({Malf} and {H}))", semantics="boolean")
    for row in rows:
        monitor.update(row)
    return len(rows)


def rtamt_online(rtamt: Any, rows: Sequence[list[tuple[str, float]]]) -> int:
    """Judge the response without its outer "always", scan by scan."""
    spec = rtamt.StlDiscreteTimeSpecification()
    for name in ("malf", "heater", "out"):
        spec.declare_var(name, "float")
    spec.set_sampling_period(10, "ms", 0.1)
    spec.unit = "s"
    spec.spec = "out = (malf >= 0.5) implies (eventually[0:22s](heater <= 0.5))"
    spec.parse()
    spec.pastify()
    for n, row in enumerate(rows):
        spec.update(n, row)
    return len(rows)


def rtamt_dense(rtamt: Any, malf: list[list[float]], heater: list[list[float]]) -> int:
    """Judge the response over a recording in dense time."""
    spec = rtamt.StlDenseTimeSpecification()
    for name in ("malf", "heater", "out"):
        spec.declare_var(name, "float")
    spec.spec = "out = always((malf >= 0.5) implies (eventually[0:22](heater <= 0.5)))"
    spec.parse()
    spec.evaluate(["malf", malf], ["heater", heater])
    return len(malf) + len(heater)


def held(frames: Sequence[Frame], names: Sequence[str]) -> Iterator[tuple[float, list[bool]]]:
    """Yield (time in s, the values of some tags) for each frame."""
    indices = [TAGS.find(name) for name in names]
    values: dict[int, object] = {}
    for frame in frames:
        values.update(frame.changes)
        yield frame.t_ns / NS_PER_S, [bool(values[i]) for i in indices]


def module(name: str) -> Any:
    """Return a peer, or None if it is not installed."""
    with contextlib.suppress(ImportError):
        return importlib.import_module(name)
    print(f"{name}: not installed here")
    return None


def row(what: str, rate: float, unit: str) -> None:
    """Print one figure."""
    print(f"{what:66} {rate:12,.0f} {unit}/s")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="of which the fastest counts")
    parser.add_argument("--events", type=int, default=1_000_000, help="of the long recording")
    options = parser.parse_args()
    rtamt, reelay = module("rtamt"), module("reelay")
    frames, rounds = scans(), options.rounds
    busy = sum(bool(frame.changes) for frame in frames)
    print(f"{len(frames):,} scans of 10 ms, {busy:,} with changes")
    row("10 properties of the papers", timed(lambda: ours_online(TEN, frames), rounds), "scans")
    row("response within 22 s", timed(lambda: ours_online(RESPONSE, frames), rounds), "scans")
    pairs = list(held(frames, ("Malf", "H")))
    if reelay:
        rows = [{"Malf": m, "H": h} for _, (m, h) in pairs]
        row("  reelay, discrete time, said of the past",
            timed(lambda: reelay_online(reelay, rows), rounds), "scans")
    if rtamt:
        few = [[("malf", float(m)), ("heater", float(h))] for _, (m, h) in pairs[:3000]]
        row("  rtamt, discrete time, without the outer always (3,000 scans)",
            timed(lambda: rtamt_online(rtamt, few), 1), "scans")
    trace = recording(options.events)
    row(f"{options.events:,} changes offline, the response",
        timed(lambda: ours_offline(trace, RESPONSE), 2), "changes")
    row(f"{options.events:,} changes offline, 10 properties",
        timed(lambda: ours_offline(trace, TEN.replace("rise(V3)", "FALSE").replace(
            "only while MR", "only while TRUE").replace("causes X11", "causes TRUE")), 2),
        "changes")
    changes = [(t, m, h) for t, (m, h) in held(trace.frames, ("Malf", "H"))]
    if reelay:
        dense = [{"time": t, "Malf": m, "H": h} for t, m, h in changes]
        row("  reelay, dense time, the response said of the past",
            timed(lambda: reelay_dense(reelay, dense), 1), "changes")
    if rtamt:
        some = changes[:10_000]
        malf, heater = [[t, float(m)] for t, m, _ in some], [[t, float(h)] for t, _, h in some]
        row("  rtamt, dense time, the response (10,000 changes)",
            timed(lambda: rtamt_dense(rtamt, malf, heater) // 2, 1), "changes")


if __name__ == "__main__":
    main()
