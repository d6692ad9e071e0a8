"""A run as a page: verdicts, counters and a chart of what was on when. One file, nothing loaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.base.trace import Trace
from plcemu.base.types import Value

ROWS = 60
"""Boolean tags drawn at most; those that change most often come first."""

BARS = 2000
"""Bars drawn for one tag at most; beyond that the chart says that it is cut."""

_WIDTH, _LEFT, _ROW = 900, 220, 18

_STYLE = """body{font:14px system-ui,sans-serif;margin:2em;color:#222}
table{border-collapse:collapse}td,th{padding:2px 10px;text-align:left;border-bottom:1px solid #ddd}
.violated{color:#b00020;font-weight:bold}.presumably{color:#8a6d00}
svg text{font:11px system-ui,sans-serif}svg rect{fill:#3b7dd8}"""


def save_report(report: Mapping[str, Any], trace: Trace, path: Path) -> None:
    """Write the page of a run.

    Raises:
        PlcemuError: the file cannot be written.
    """
    name = escape(report["name"] or "PLC")
    page = (f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{name}</title>"
            f"<style>{_STYLE}</style><h1>{name}</h1>{_summary(report)}"
            f"{_properties(report['properties'])}{_chart(trace)}</html>\n")
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as problem:
        raise PlcemuError(f"{path}: cannot be written: {problem.strerror}") from None


def _summary(report: Mapping[str, Any]) -> str:
    rows = {key: report[key] for key in ("state", "t_s", "scans", "overruns", "fault")
            if key in report}
    plant = report.get("plant") or {}
    rows |= {f"plant {k}": v for k, v in plant.items()
             if isinstance(v, bool | int | float | str) and v != ""}
    return "<table>" + "".join(f"<tr><th>{escape(str(k))}<td>{escape(str(v))}"
                               for k, v in rows.items()) + "</table>"


def _properties(properties: Sequence[Mapping[str, Any]]) -> str:
    if not properties:
        return ""
    rows = []
    for entry in properties:
        decided = entry["decided_at_s"]
        css = "violated" if entry["verdict"] == "violated" else entry["verdict"].split()[0]
        cells = (entry["name"], entry["verdict"], entry["triggers"],
                 "" if decided is None else f"{decided:g} s", entry["formula"],
                 entry["description"])
        rows.append(f"<tr class='{css}'>" + "".join(f"<td>{escape(str(c))}" for c in cells))
    return ("<h2>Properties</h2><table><tr><th>name<th>verdict<th>triggers<th>decided at"
            "<th>formula<th>meaning" + "".join(rows) + "</table>")


def _chart(trace: Trace) -> str:
    """Draw when each Boolean tag was TRUE."""
    bars = _intervals(trace)
    if not bars or trace.end_ns <= 0:
        return ""
    chosen = sorted(sorted(bars, key=lambda i: -len(bars[i]))[:ROWS])
    height = _ROW * (len(chosen) + 2)
    parts = [f"<h2>What was on when</h2><svg width='{_LEFT + _WIDTH + 20}' height='{height}'>"]
    for row, index in enumerate(chosen):
        y = _ROW * row
        parts.append(f"<text x='0' y='{y + 12}'>{escape(trace.tags[index].name)}</text>")
        for begin, end in bars[index][:BARS]:
            x = _LEFT + _WIDTH * begin / trace.end_ns
            width = max(0.5, _WIDTH * (end - begin) / trace.end_ns)
            parts.append(f"<rect x='{x:.2f}' y='{y + 3}' width='{width:.2f}' height='11'>"
                         f"<title>{begin / 1e9:g} s to {end / 1e9:g} s</title></rect>")
    parts.append(f"<text x='{_LEFT}' y='{height - 8}'>0 s</text><text x='{_LEFT + _WIDTH - 40}' "
                 f"y='{height - 8}'>{trace.end_ns / 1e9:g} s</text></svg>")
    if len(bars) > ROWS or any(len(b) > BARS for b in bars.values()):
        parts.append(f"<p>The chart is cut: {ROWS} tags and {BARS} bars a tag are drawn.</p>")
    return "".join(parts)


def _intervals(trace: Trace) -> dict[int, list[tuple[int, int]]]:
    """Return for each Boolean tag that changes the stretches in which it was TRUE."""
    since: dict[int, int] = {}
    bars: dict[int, list[tuple[int, int]]] = {}
    changes: dict[int, int] = {}
    for frame in trace.frames:
        for index, value in frame.changes:
            if trace.tags[index].type == "BOOL":
                changes[index] = changes.get(index, 0) + 1
                _toggle(index, value, frame.t_ns, since, bars)
    for index, begin in since.items():
        bars.setdefault(index, []).append((begin, trace.end_ns))
    return {i: b for i, b in bars.items() if changes[i] > 1}


def _toggle(index: int, value: Value | None, t_ns: int, since: dict[int, int],
            bars: dict[int, list[tuple[int, int]]]) -> None:
    if value:
        since.setdefault(index, t_ns)
    elif index in since:
        bars.setdefault(index, []).append((since.pop(index), t_ns))
