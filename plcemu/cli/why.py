"""`plcemu why`: why a tag has its value at an instant of a run."""

from __future__ import annotations

import argparse
from pathlib import Path

from plcemu.base.errors import ConfigError
from plcemu.base.time import NS_PER_S, format_duration
from plcemu.cli.output import (
    add_scenario_arguments,
    add_set_argument,
    duration,
    print_json,
    scenario_of,
)
from plcemu.cli.progress import run_with_progress
from plcemu.runtime.config import load_config
from plcemu.runtime.history import History
from plcemu.runtime.system import System
from plcemu.runtime.why import DEPTH, Why

HELP = "explain a tag's value: the instructions, steps, timers and inputs that made it so"
EPILOG = """The run is simulated up to the instant, as `plcemu simulate` does it, and looked into
from there backwards. Each line is a value, since when it holds, and the line that wrote it; below
it stand the values that it was made from. CONFIG may stand before or after TAG.

examples:
  plcemu why V8 il_programs/batch_plant --at 100s
  plcemu why V8 il_programs/batch_plant --set load=3 --at 1h --depth 4 --json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    parser.add_argument("tag", metavar="TAG", help="a tag's name, or an address such as %%QX0.0")
    parser.add_argument("config", nargs="?", metavar="CONFIG",
                        help="a configuration file, or a folder with config.yaml "
                        "(default: ./config.yaml)")
    parser.add_argument("--at", required=True, metavar="T", type=duration,
                        help="the instant, in the PLC's time, such as 100s")
    parser.add_argument("--depth", type=int, default=DEPTH, metavar="N",
                        help=f"how many causes deep (default: {DEPTH})")
    parser.add_argument("--no-plant", action="store_true",
                        help="run the PLC alone; inputs come from a scenario only")
    add_set_argument(parser)
    add_scenario_arguments(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Explain, and return 0."""
    tag, config = arguments.tag, arguments.config
    if config is not None and Path(tag).exists() and not Path(config).exists():
        tag, config = config, tag
    if arguments.depth < 1:
        raise ConfigError([f"--depth: found {arguments.depth}, expected 1 or more"])
    system = System(load_config(config, arguments.overrides),
                    with_plant=not arguments.no_plant, scenario=scenario_of(arguments))
    if not tag.lstrip().startswith("%"):
        system.cycle.tags.find(tag)  # a wrong name is told before the run, not after it
    history = History(system.cycle)
    run_with_progress(system.cycle, arguments.at + 1)
    why = Why(history, system.cycle)
    cause = why.explain(tag, why.scan_at(arguments.at), arguments.depth)
    if arguments.json:
        print_json({"tag": cause.tag, "at_s": arguments.at / NS_PER_S, **cause.as_json()})
    else:
        print(f"at {format_duration(arguments.at)}:")
        print(cause)
    return 0
