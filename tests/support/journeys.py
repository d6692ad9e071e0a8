"""Random programs and random things done to a PLC, for the tests of time travel."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from hypothesis import strategies as st

import plcemu

Deed = Callable[[plcemu.Plc], object]

_HEAD = """PROGRAM MAIN
VAR start AT %IX0.0 : BOOL; level AT %IW1 : INT; lamp AT %QX0.0 : BOOL; speed AT %QW1 : INT; END_VAR
VAR n, m : INT; on : BOOL; delay : TON; real : REAL; word : STRING[8]; END_VAR
"""
_STATEMENTS = (
    "n := n + 1;", "IF start THEN m := m + level; END_IF;", "lamp := start AND NOT on;",
    "delay(IN := start, PT := T#35ms);", "on := delay.Q;", "speed := level / 3;",
    "real := real / 3.0 + INT_TO_REAL(level);", "word := CONCAT(word, 'x');",
    "IF n > 12 THEN n := 0; word := ''; END_IF;", "m := 100 / (level + 7);",
    "on := on XOR start;", "IF lamp THEN speed := n; END_IF;")

programs = st.lists(st.sampled_from(_STATEMENTS), min_size=1, max_size=8).map(
    lambda lines: _HEAD + "\n".join(lines) + "\nEND_PROGRAM\n")
"""Programs that count, time, divide (by zero at level -7) and join strings."""

_levels = st.sampled_from([-7, -1, 0, 5, 300])


def _write(name: str, value: plcemu.base.types.Value) -> Deed:
    return lambda plc: plc.__setitem__(name, value)


inputs: st.SearchStrategy[Deed] = st.one_of(
    st.booleans().map(lambda on: _write("start", on)), _levels.map(lambda v: _write("level", v)),
    st.booleans().map(lambda on: _write("%QX3.1", on)))
"""Writes of a client: to inputs, and to a coil that no program has."""

commands: st.SearchStrategy[Deed] = st.one_of(
    st.booleans().map(lambda on: lambda plc: plc.force("lamp", on)),
    _levels.map(lambda v: lambda plc: plc.force("level", v)),
    st.sampled_from(["lamp", "level"]).map(lambda name: lambda plc: plc.unforce(name)),
    st.just(lambda plc: plc.stop()), st.just(lambda plc: plc.resume()),
    st.booleans().map(lambda cold: lambda plc: plc.restart(cold)))
"""What is done to a PLC besides writes."""

scans: st.SearchStrategy[Deed] = st.one_of(
    st.integers(1, 4).map(lambda n: lambda plc: plc.scan(n)),
    st.sampled_from(["20ms", "100ms", "2s"]).map(lambda time: lambda plc: plc.run_for(time)))
"""Time going on, densely or with scans passed over."""

journeys = st.lists(st.one_of(scans, scans, inputs, inputs, commands), min_size=1, max_size=14)


def do(plc: plcemu.Plc, deeds: Iterable[Deed]) -> None:
    """Do everything in order."""
    for deed in deeds:
        deed(plc)


def stand(plc: plcemu.Plc) -> tuple[object, ...]:
    """Return all that can be seen of a PLC."""
    return (plc.snapshot(), plc.t_ns, plc.scan_number, plc.state, plc.fault, plc["%QX3.1"],
            [plc[tag.name] for tag in plc.tags])
