"""`plcemu run`: the daemon."""

from __future__ import annotations

import argparse
import asyncio
import sys

from plcemu.cli.live import LiveView
from plcemu.cli.output import (
    add_config_arguments,
    add_scenario_arguments,
    duration,
    failed,
    print_json,
    print_report,
    scenario_of,
    set_up_logging,
    show_warnings,
)
from plcemu.runtime.config import load_config
from plcemu.runtime.daemon import Daemon
from plcemu.runtime.system import System

NAME = "run"
HELP = "the daemon: PLC, Modbus server, plant and monitors in real time"
EPILOG = """Ctrl-C or SIGTERM bring the outputs to their safe values and end it.

examples:
  plcemu run
  plcemu run il_programs/batch_plant --set load=3 --set time_scale=100
  plcemu run il_programs/batch_plant --no-plant     # then, beside it:
  plcemu plant il_programs/batch_plant --connect 127.0.0.1:5020"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    add_config_arguments(parser)
    add_scenario_arguments(parser)
    parser.add_argument("--for", dest="duration", metavar="DURATION", type=duration,
                        help="stop after this much of the PLC's time")
    parser.add_argument("--no-plant", action="store_true",
                        help="run no plant in this process; one connects by Modbus")
    parser.add_argument("--verbose", action="store_true", help="log more")
    parser.add_argument("--no-live", action="store_true",
                        help="log lines instead of the live view, on a terminal too")


def execute(arguments: argparse.Namespace) -> int:
    """Run until stopped, and return 1 if a property was violated or the program faulted."""
    system = System(load_config(arguments.config, arguments.overrides),
                    with_plant=not arguments.no_plant, scenario=scenario_of(arguments))
    live = sys.stderr.isatty() and not arguments.json and not arguments.no_live
    set_up_logging(arguments.verbose)
    show_warnings(system.warnings)
    daemon = Daemon(system, arguments.duration)
    report = asyncio.run(_run(daemon, LiveView(daemon, arguments.verbose) if live else None))
    if arguments.json:
        print_json(report)
    else:
        print_report(report)
    return 1 if failed(report) else 0


async def _run(daemon: Daemon, view: LiveView | None) -> dict[str, object]:
    if view is not None:
        with view:
            await daemon.run(view.on_lap)
    else:
        await daemon.run()
    return daemon.report()
