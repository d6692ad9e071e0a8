"""`plcemu sweep`: a family of runs over parameters and chance."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from plcemu.base.errors import PlcemuError
from plcemu.cli.output import add_config_arguments, console, duration, print_json
from plcemu.runtime.config import ConfigText
from plcemu.runtime.plot import FORMATS, check_plot
from plcemu.runtime.sweep import Design, Plan, Result, make_plan
from plcemu.runtime.sweep_table import Summary, save_csv, save_plot, summarise
from plcemu.runtime.variation import SYNTAX, parse_variation
from plcemu.runtime.workers import cores, run_here, run_on_cluster, run_on_cores

HELP = "a family of runs over parameters and chance, in virtual time and on all cores"
EPILOG = f"""What is varied is written {SYNTAX}.
Lists and grids are combined; each combination is run --runs times, each time with other chance.
What is left out is taken from the section sweep of the configuration. Every run can be repeated
alone: `plcemu simulate CONFIG --set ...` with the parameters shown for it.

examples:
  plcemu sweep il_programs/conveyor --runs 1000
  plcemu sweep il_programs/conveyor --vary cycle=5ms..15ms:0.1ms --runs 20 --plot range.svg
  plcemu sweep il_programs/conveyor --vary speed_mm_s=199..201 --runs 500 --csv runs.csv
  plcemu sweep il_programs/batch_plant --vary load=1,2,3 --until 40000s

Exit code 1 if a property was violated or a program faulted in any run."""

POINTS_SHOWN = 60
"""Rows of the table; the rest is in the CSV or JSON."""

INTERRUPTED = 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    add_config_arguments(parser)
    parser.add_argument("--until", metavar="DURATION", type=duration,
                        help="how long each run is, in the PLC's time")
    parser.add_argument("--vary", metavar="NAME=VALUES", action="append", default=[],
                        help="vary a key of the configuration; may be given several times")
    parser.add_argument("--runs", metavar="N", type=_count, help="runs of each combination")
    parser.add_argument("--seed", metavar="S", type=int, help="of all chance in the sweep")
    parser.add_argument("--collect", metavar="TAG", action="append", default=[],
                        help="a tag whose last value is collected, or min(TAG), max(TAG); without "
                        "it all facts of the plant")
    parser.add_argument("--csv", metavar="FILE", type=Path, help="write one row a run")
    parser.add_argument("--plot", metavar="FILE", type=Path,
                        help=f"draw what was collected ({', '.join(FORMATS)})")
    parser.add_argument("--workers", metavar="N", type=_count,
                        help="processes (default: one a core)")
    parser.add_argument("--scheduler", metavar="ADDRESS",
                        help="execute the runs on a Dask cluster, such as tcp://host:8786")


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number above 0")
    return int(text)


def execute(arguments: argparse.Namespace) -> int:
    """Run the family, and return 1 if a property is violated or a program faults in any run."""
    _check_files(arguments)
    text = ConfigText.read(arguments.config)
    config = text.config(arguments.overrides)
    section = config.sweep
    until = arguments.until or section.until
    if until is None:
        raise PlcemuError("how long is a run? give --until DURATION, or sweep.until in the "
                          "configuration")
    given = {v.name: v for v in map(parse_variation, arguments.vary)}
    configured = {name: parse_variation(f"{name}={spec}") for name, spec in section.vary.items()}
    seed = section.seed if arguments.seed is None else arguments.seed
    design = Design(tuple({**configured, **given}.values()), arguments.runs or section.runs, seed)
    plan = make_plan(text, arguments.overrides, until, design, arguments.collect or section.collect)
    results, interrupted = _collect(plan, design, _executor(plan, design, arguments))
    results.sort(key=lambda r: r.run.number)
    summaries = summarise(plan, results)
    if arguments.csv is not None:
        save_csv(plan, design, results, arguments.csv)
    if arguments.plot is not None and results:
        save_plot(plan, design, results, arguments.plot)
    if arguments.json:
        print_json(_document(config.name, plan, design, results, summaries, interrupted))
    else:
        _print(config.title, plan, design, results, summaries, interrupted)
    if interrupted:
        return INTERRUPTED
    return 1 if any(s.violated or s.errors for s in summaries) else 0


def _check_files(arguments: argparse.Namespace) -> None:
    """Refuse at once what could not be written after a long sweep."""
    if arguments.plot is not None:
        check_plot(arguments.plot)
    for path in (arguments.csv, arguments.plot):
        if path is not None and (path.is_dir() or not path.parent.is_dir()):
            raise PlcemuError(f"{path}: cannot be written: it is a folder, or in no folder")


def _executor(plan: Plan, design: Design,
              arguments: argparse.Namespace) -> Callable[[], Iterator[list[Result]]]:
    if arguments.scheduler:
        return lambda: run_on_cluster(plan, design, arguments.scheduler)
    workers = min(arguments.workers or cores(), design.total)
    if workers == 1:
        return lambda: run_here(plan, design)
    return lambda: run_on_cores(plan, design, workers)


def _collect(plan: Plan, design: Design,
             run: Callable[[], Iterator[list[Result]]]) -> tuple[list[Result], bool]:
    """Return the results, and whether Ctrl-C ended the sweep before all were there."""
    results: list[Result] = []
    columns = (TextColumn("sweeping"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(to_stderr=True), transient=True,
                  disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("", total=design.total)
        try:
            for finished in run():
                results += finished
                progress.advance(bar, len(finished))
        except KeyboardInterrupt:
            return results, True
    return results, False


# ---------------------------------------------------------------- results


def _document(name: str, plan: Plan, design: Design, results: Sequence[Result],
              summaries: Sequence[Summary], interrupted: bool) -> dict[str, Any]:
    grid = [v.name for v in design.grid]
    return {"name": name, "until_s": plan.until_ns / 1e9, "runs": design.total,
            "finished": len(results), "interrupted": interrupted,
            "varied": [v.name for v in design.variations],
            "collected": [m.label for m in plan.measures],
            "summary": [s.as_json(grid) for s in summaries],
            "results": [r.as_json() for r in results]}


def _print(name: str, plan: Plan, design: Design, results: Sequence[Result],
           summaries: Sequence[Summary], interrupted: bool) -> None:
    out = console()
    ended = ", interrupted: what follows is of the finished runs" if interrupted else ""
    out.print(f"{name or 'PLC'}: {len(results)} of {design.total} runs of "
              f"{plan.until_ns / 1e9:g} s{ended}")
    if summaries:
        out.print(_table(plan, design, summaries))
    if len(summaries) > POINTS_SHOWN:
        out.print(f"... and {len(summaries) - POINTS_SHOWN} more; --csv and --json have all")
    for line in _troubles(results):
        out.print(line, style="bold red")


def _table(plan: Plan, design: Design, summaries: Sequence[Summary]) -> Table:
    table = Table(box=None, pad_edge=False)
    if not design.grid:
        for heading in ("collected", "min", "mean", "max"):
            table.add_column(heading, justify="left" if heading == "collected" else "right")
        for label, numbers in summaries[0].numbers.items():
            table.add_row(label, *(f"{each:.9g}" for each in numbers))
        return table
    single = design.runs == 1
    labels = [m.label for m in plan.measures if any(m.label in s.numbers for s in summaries)]
    for heading in (*(v.name for v in design.grid), *labels):
        table.add_column(heading, justify="right")
    for summary in summaries[:POINTS_SHOWN]:
        cells = []
        for label in labels:
            low, _, high = summary.numbers.get(label, (float("nan"),) * 3)
            cells.append(f"{low:.9g}" if single or low == high else f"{low:.9g} .. {high:.9g}")
        table.add_row(*summary.point, *cells)
    return table


def _troubles(results: Sequence[Result]) -> Iterator[str]:
    """Yield a line for each property that was violated and for faults, with a run to repeat."""
    found: dict[str, list[Result]] = {}
    for result in results:
        for name, verdict in result.verdicts.items():
            if verdict == "violated":
                found.setdefault(f"{name} is violated", []).append(result)
        if result.error:
            found.setdefault(result.error, []).append(result)
    for what, bad in found.items():
        sets = " ".join(f"--set {each}" for each in bad[0].run.overrides)
        yield f"{what} in {len(bad)} of {len(results)} runs, first with {sets}".rstrip()
