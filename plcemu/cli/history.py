"""`plcemu history`: read a historian's file."""

from __future__ import annotations

import argparse
from pathlib import Path

from plcemu.base import historyfile
from plcemu.base.errors import ConfigError
from plcemu.base.time import NS_PER_S, format_duration
from plcemu.base.trace import Trace
from plcemu.base.tracefile import save
from plcemu.cli.output import duration, print_json

HELP = "read what the historian of `plcemu run` wrote: its runs, and what changed when"
EPILOG = """Without more it lists the runs in the file. With --tags, --from, --to or --run it prints
the changes of one run; with --export it writes them to a file.

examples:
  plcemu history history.sqlite
  plcemu history history.sqlite --tags MAIN.pump,plant.level --from 10min --to 12min
  plcemu history history.sqlite --run 3 --export run.vcd"""

ROWS = 10_000
"""Changes printed at most; the rest is counted."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    parser.add_argument("file", metavar="FILE", type=Path, help="the historian's file")
    parser.add_argument("--run", metavar="N", type=int, help="its number (default: the last one)")
    parser.add_argument("--tags", metavar="TAG,TAG", default="", help="only these")
    parser.add_argument("--from", dest="begin", metavar="T", type=duration,
                        help="from this instant on, in the PLC's time")
    parser.add_argument("--to", dest="end", metavar="T", type=duration, help="up to this one")
    parser.add_argument("--export", metavar="FILE", type=Path,
                        help="write a trace: .vcd, .csv or .jsonl")


def execute(arguments: argparse.Namespace) -> int:
    """Print or export, and return 0."""
    if not arguments.file.is_file():
        raise ConfigError([f"{arguments.file}: there is no such file"])
    names = [name.strip() for name in arguments.tags.split(",") if name.strip()]
    asked = (arguments.run, arguments.begin, arguments.end, arguments.export)
    if not names and all(each is None for each in asked):
        _print_runs(arguments)
        return 0
    trace = historyfile.read(arguments.file, arguments.run, arguments.begin or 0, arguments.end,
                             names)
    if arguments.export is not None:
        save(trace, arguments.export)
        if not arguments.json:
            print(f"{arguments.export}: {len(trace.frames)} frames of {len(trace.tags)} tags")
    if arguments.json:
        print_json(_document(trace))
    elif arguments.export is None:
        _print_changes(trace)
    return 0


def _print_runs(arguments: argparse.Namespace) -> None:
    runs = historyfile.runs(arguments.file)
    if arguments.json:
        print_json({"runs": [{"run": r.id, "name": r.name, "began": r.began, "ended": r.ended,
                              "begin_s": r.begin_ns / NS_PER_S, "end_s": r.end_ns / NS_PER_S,
                              "frames": r.frames} for r in runs]})
        return
    for run in runs:
        print(f"run {run.id}: {run.name or 'PLC'}, {run.began[:19]} to {run.ended[:19]} UTC, "
              f"{format_duration(run.begin_ns)} to {format_duration(run.end_ns)}, "
              f"{run.frames} frames")


def _document(trace: Trace) -> dict[str, object]:
    return {"end_s": trace.end_ns / NS_PER_S, "tags": [tag.name for tag in trace.tags],
            "frames": [{"t_s": f.t_ns / NS_PER_S, "scan": f.scan,
                        "changes": {trace.tags[i].name: v for i, v in f.changes}}
                       for f in trace.frames]}


def _print_changes(trace: Trace) -> None:
    rows = [(frame.t_ns, trace.tags[i], value) for frame in trace.frames
            for i, value in frame.changes]
    for t_ns, tag, value in rows[:ROWS]:
        print(f"{format_duration(t_ns):>14}  {tag.name} := {tag.shown(value)}")
    if len(rows) > ROWS:
        print(f"... and {len(rows) - ROWS} more changes; --export writes all")
