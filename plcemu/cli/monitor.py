"""`plcemu monitor`: judge a recorded trace."""

from __future__ import annotations

import argparse
from pathlib import Path

from plcemu.base.errors import ConfigError
from plcemu.base.tracefile import load
from plcemu.cli.output import console, print_json, properties_table
from plcemu.cli.traces import add_reading_arguments, reading_of
from plcemu.monitor import judge, load_properties

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
    add_reading_arguments(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Judge, and return 1 if a property is violated."""
    for path in (arguments.trace, arguments.properties):
        if not path.is_file():
            raise ConfigError([f"{path}: there is no such file"])
    results = judge(load(arguments.trace, reading_of(arguments)),
                    load_properties(arguments.properties))
    rows = [r.as_json() for r in results]
    if arguments.json:
        print_json({"properties": rows})
    else:
        out = console()
        out.print(properties_table(rows, out.width))
    return 1 if any(r.failed for r in results) else 0
