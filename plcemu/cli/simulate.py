"""`plcemu simulate`: the closed loop of PLC, plant and monitors in virtual time."""

from __future__ import annotations

import argparse
from pathlib import Path

from plcemu.base.errors import PlcemuError
from plcemu.base.time import format_duration
from plcemu.base.trace import Trace
from plcemu.base.tracefile import FORMATS, save
from plcemu.cli.output import (
    add_config_arguments,
    add_scenario_arguments,
    duration,
    failed,
    print_json,
    print_report,
    scenario_of,
    show_warnings,
)
from plcemu.cli.progress import run_with_progress
from plcemu.runtime.config import load_config
from plcemu.runtime.inputlog import InputLog
from plcemu.runtime.plot import check_plot, panels_of, save_plot
from plcemu.runtime.report import save_report
from plcemu.runtime.system import System

HELP = "run PLC, plant and monitors in virtual time, as fast as the machine can"
EPILOG = """examples:
  plcemu simulate il_programs/batch_plant --set load=3 --until 40000s --trace run.vcd
  plcemu simulate il_programs/batch_plant --fault 'V8 stuck at 100s' --until 4000s"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    add_config_arguments(parser)
    add_scenario_arguments(parser)
    parser.add_argument("--no-plant", action="store_true",
                        help="run the PLC alone; inputs come from a scenario only")
    parser.add_argument("--until", required=True, metavar="DURATION", type=duration,
                        help="how long to run, in the PLC's time, such as 10h or 3600s")
    parser.add_argument("--trace", metavar="FILE", type=Path,
                        help="write every change to a file: .vcd, .csv or .jsonl")
    parser.add_argument("--report", metavar="FILE.html", type=Path,
                        help="write a page with verdicts and a chart of the run")
    parser.add_argument("--plot", metavar="FILE", type=Path,
                        help="draw curves over time: .svg, .pdf or .png; which, says 'plot:' in "
                        "the configuration (needs the extra 'plot')")
    parser.add_argument("--save", metavar="FOLDER", type=Path,
                        help="write what led to each violation as a scenario, NAME.yaml, that "
                        "plays again with --no-plant --scenario")
    parser.add_argument("--dense", action="store_true",
                        help="execute every scan, also those that cannot change anything")


def execute(arguments: argparse.Namespace) -> int:
    """Simulate, and return 1 if a property is violated or the program faults."""
    _check_files(arguments.trace, arguments.report, arguments.plot)
    if arguments.save is not None and not arguments.save.is_dir():
        raise PlcemuError(f"--save {arguments.save}: there is no such folder")
    system = System(load_config(arguments.config, arguments.overrides),
                    with_plant=not arguments.no_plant, scenario=scenario_of(arguments))
    if not arguments.json:
        show_warnings(system.warnings)
    trace = None
    if any((arguments.trace, arguments.report, arguments.plot)):
        trace = Trace(system.cycle.tags)
        # The page's chart shows no elapsed times.
        only_page = arguments.trace is None and arguments.plot is None
        (system.cycle.state_observers if only_page else system.cycle.observers).append(trace)
    log = InputLog(system.cycle.tags, system.scenario)
    if arguments.save is not None:
        system.cycle.state_observers.append(log)
    panels = panels_of(Trace(system.cycle.tags), system.config.plot)
    run_with_progress(system.cycle, arguments.until, arguments.dense)
    system.close()
    report = system.report()
    if trace is not None:
        trace.end_ns = system.cycle.end_ns
        if arguments.trace is not None:
            save(trace, arguments.trace)
        if arguments.report is not None:
            save_report(report, trace, arguments.report)
        if arguments.plot is not None:
            save_plot(trace, panels or panels_of(trace, {}), arguments.plot, system.config.title)
    saved = _save(arguments.save, system, log) if arguments.save is not None else []
    if arguments.json:
        print_json(report)
    else:
        print_report(report)
        for line in saved:
            print(line)
    return 1 if failed(report) else 0


def _save(folder: Path, system: System, log: InputLog) -> list[str]:
    """Write what led to each violation as a scenario; return how each is played."""
    told = []
    for result in system.cycle.suite.results():
        if not result.failed or result.decided_at_ns is None:
            continue
        if log.problem:
            told.append(f"{result.name}: nothing is written: {log.problem}")
            continue
        file = folder / f"{result.name}.yaml"
        text = f"{result.name} is violated at {result.decided_at_ns / 1e9:g} s: {result.formula}"
        file.write_text(log.scenario(result.decided_at_ns, text), encoding="utf-8")
        until = format_duration(result.decided_at_ns + 2 * system.config.cycle)
        told.append(f"written: {file}; plays again with: plcemu simulate CONFIG --no-plant "
                    f"--scenario {file} --until {until}")
    return told


def _check_files(trace: Path | None, report: Path | None, plot: Path | None) -> None:
    """Refuse at once what could not be written after a long run."""
    if plot is not None:
        check_plot(plot)
    if trace is not None and trace.suffix.lower() not in FORMATS:
        raise PlcemuError(f"--trace {trace}: found the ending {trace.suffix!r}, expected one of "
                          f"{', '.join(FORMATS)}")
    for path in (trace, report, plot):
        if path is not None and (path.is_dir() or not path.parent.is_dir()):
            raise PlcemuError(f"{path}: cannot be written: it is a folder, or in no folder")
