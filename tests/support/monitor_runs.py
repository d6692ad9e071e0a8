"""Runs for the monitor's tests, written as the moments at which something changes."""

from __future__ import annotations

from plcemu.base.tags import Tag, TagTable
from plcemu.base.time import NS_PER_S
from plcemu.base.trace import Frame, Trace
from plcemu.base.types import Value
from plcemu.monitor import Monitor, Result

S = NS_PER_S
Changes = dict[str, Value | None]
_TYPES = {bool: "BOOL", int: "LINT", float: "LREAL", str: "STRING"}


def run_of(end_s: float, *moments: tuple[float, Changes]) -> Trace:
    """Return a trace; the first moment gives every tag its value, None is not known."""
    tags = TagTable([Tag(n, _TYPES.get(type(v), "BOOL")) for n, v in moments[0][1].items()])
    frames = [Frame(round(t * S), i, tuple((tags.find(n), v) for n, v in changes.items()))
              for i, (t, changes) in enumerate(moments)]
    return Trace(tags, frames, round(end_s * S))


def check(formula: str, trace: Trace) -> Result:
    """Judge a run by one formula."""
    return Monitor(formula).check(trace)
