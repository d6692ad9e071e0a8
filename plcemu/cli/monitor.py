"""`plcemu monitor`: judge a recorded trace."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from plcemu.base.errors import ConfigError, PlcemuError
from plcemu.base.tracefile import load, save
from plcemu.cli.output import console, print_json, print_stories, properties_table
from plcemu.cli.traces import add_reading_arguments, reading_of
from plcemu.monitor import Result, judge, load_properties

HELP = ("judge a recorded trace (.csv, .jsonl, .vcd, or a historian's .sqlite) by the properties "
        "of a .prop file")
EPILOG = """examples:
  plcemu monitor run.vcd properties.prop
  plcemu monitor scope.csv properties.prop --time 'Time [ms]' --unit ms --rename CH1=MAIN.pump
  plcemu monitor history.sqlite properties.prop --run 3"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    parser.add_argument("trace", metavar="TRACE", type=Path, help="the recording")
    parser.add_argument("properties", metavar="PROPERTIES", type=Path, help="a .prop file")
    parser.add_argument("--excerpts", metavar="FOLDER", type=Path,
                        help="write the last frames before each violation to FOLDER/NAME.jsonl")
    add_reading_arguments(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Judge, and return 1 if a property is violated."""
    for path in (arguments.trace, arguments.properties):
        if not path.is_file():
            raise ConfigError([f"{path}: there is no such file"])
    results = judge(load(arguments.trace, reading_of(arguments)),
                    load_properties(arguments.properties))
    rows = [r.as_json() for r in results]
    if arguments.excerpts is not None:
        _save_excerpts(results, arguments.excerpts)
    if arguments.json:
        print_json({"properties": rows})
    else:
        out = console()
        out.print(properties_table(rows, out.width))
        print_stories(out, rows)
    return 1 if any(r.failed for r in results) else 0


def _save_excerpts(results: Sequence[Result], folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for result in results:
            if result.violation is not None and result.violation.excerpt is not None:
                save(result.violation.excerpt, folder / f"{result.name}.jsonl")
    except OSError as problem:
        raise PlcemuError(f"{folder}: cannot be written: {problem.strerror}") from None
