"""`plcemu run`: the daemon."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
from typing import TYPE_CHECKING

from plcemu.cli.output import (
    add_config_arguments,
    add_log_arguments,
    add_scenario_arguments,
    duration,
    failed,
    print_json,
    print_report,
    scenario_of,
    set_up_log,
    show_warnings,
)
from plcemu.runtime.config import Config, load_config
from plcemu.runtime.daemon import Daemon
from plcemu.runtime.system import System

if TYPE_CHECKING:
    from plcemu.cli.live import LiveView

HELP = "the daemon: PLC, Modbus server, plant and monitors in real time"
EPILOG = """Ctrl-C or SIGTERM bring the outputs to their safe values, keep the retained variables
and end it; SIGHUP loads the program anew. `plcemu control` asks and commands it meanwhile.

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
    parser.add_argument("--cold", action="store_true",
                        help="start retained variables at their initial values")
    add_log_arguments(parser)
    parser.add_argument("--no-live", action="store_true",
                        help="log lines instead of the live view, on a terminal too")


def execute(arguments: argparse.Namespace) -> int:
    """Run until stopped, and return 1 if a property was violated or the program faulted."""
    def read_config() -> Config:
        return load_config(arguments.config, arguments.overrides)

    config = read_config()
    set_up_log(arguments)
    system = System(config, with_plant=not arguments.no_plant,
                    retain="cold" if arguments.cold else "warm",
                    scenario=scenario_of(arguments))
    if arguments.log_format == "json":
        for warning in system.warnings:
            logging.getLogger("plcemu.lang").warning("%s", warning)
    else:
        show_warnings(system.warnings)
    daemon = Daemon(system, arguments.duration, read_config)
    report = asyncio.run(_run(daemon, _live_view(daemon, arguments)))
    if arguments.json:
        print_json(report)
    else:
        print_report(report)
    return 1 if failed(report) else 0


def _live_view(daemon: Daemon, arguments: argparse.Namespace) -> LiveView | None:
    """Return the live view where a person can see it."""
    if not sys.stderr.isatty() or arguments.json or arguments.no_live \
            or arguments.log_format == "json":
        return None
    from plcemu.cli.live import LiveView

    return LiveView(daemon, lambda: set_up_log(arguments))


async def _run(daemon: Daemon, view: LiveView | None) -> dict[str, object]:
    if view is not None:
        with view:
            await daemon.run(view.on_lap)
    else:
        await daemon.run()
    return daemon.report()
