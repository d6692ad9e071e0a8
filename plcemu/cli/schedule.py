"""`plcemu schedule`: best schedules with their proof."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.status import Status
from rich.table import Table

from plant_sim.abstraction import Case
from plcemu.base.errors import PlcemuError
from plcemu.cli.output import add_config_arguments, console, print_json
from plcemu.runtime.config import load_config
from plcemu.runtime.scheduling import Best, Scheduler

HELP = "find the best schedules of a plant's processes, with a proof that none is better"
EPILOG = """examples:
  plcemu schedule il_programs/batch_plant --load all
  plcemu schedule il_programs/batch_plant --load 7 --batches 10 --gantt load7.svg
  plcemu schedule il_programs/batch_plant --load 7 --emit load7.sfc
  plcemu simulate il_programs/batch_plant --set program=load7.sfc --set load=7 --until 60000s

Exit code 1 if nothing can be produced from the load (with all loads, those are only named), or if
a proof does not stand the independent check."""

_SHOWN = 10
"""Batch starts that are shown before the rest is only counted."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    add_config_arguments(parser)
    parser.add_argument("--load", default="configured", metavar="N|all",
                        help="the initial load, or all of them (default: as configured)")
    parser.add_argument("--batches", type=_positive, default=10, metavar="N",
                        help="also the earliest start of this batch (default: 10)")
    parser.add_argument("--emit", type=Path, metavar="FILE",
                        help="write a program that follows the best schedule")
    parser.add_argument("--gantt", type=Path, metavar="FILE",
                        help="draw the schedule of the earliest last batch: .svg, .png or .pdf "
                        "(needs the extra 'plot')")


def _positive(text: str) -> int:
    number = int(text) if text.isdecimal() else 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return number


def execute(arguments: argparse.Namespace) -> int:
    """Schedule, and return 1 if nothing can be produced or a proof is wrong."""
    scheduler = Scheduler(load_config(arguments.config, arguments.overrides))
    cases = scheduler.cases(arguments.load)
    if len(cases) > 1 and (arguments.emit or arguments.gantt):
        raise PlcemuError("--emit and --gantt need one load; name it with --load N, and its half "
                          f"with --set half=...: there are {'; '.join(c.name for c in cases)}")
    begin = time.monotonic()
    found = list(_worked_off(scheduler, cases, arguments.batches))
    seconds = time.monotonic() - begin
    if arguments.emit:
        arguments.emit.write_text(scheduler.program(found[0]), encoding="utf-8")
    if arguments.gantt:
        _draw(scheduler, found[0], arguments.gantt)
    if arguments.json:
        print_json(document_of(scheduler, found, seconds))
    else:
        _print(scheduler, found, seconds, arguments)
    if any(b.flaw for b in found):
        return 1
    return 1 if arguments.load != "all" and not all(b.certificate for b in found) else 0


def _worked_off(scheduler: Scheduler, cases: Sequence[Case], batches: int) -> Iterator[Best]:
    """Yield the best schedule of each case, telling on a terminal which one is at work."""
    with Status("scheduling", console=console(to_stderr=True)) as status:
        if not sys.stderr.isatty():
            status.stop()
        for case in cases:
            status.update(f"scheduling {case.name}")
            yield scheduler.best(case, batches)


def document_of(scheduler: Scheduler, found: Sequence[Best], seconds: float) -> dict[str, Any]:
    """Return the JSON document: one schedule, or a list of them under `schedules`."""
    rows = [b.as_json(scheduler.scheduling.counted) for b in found]
    common = {"name": scheduler.config.name, "seconds": round(seconds, 3)}
    return {**common, **rows[0]} if len(rows) == 1 else {**common, "schedules": rows}


def _print(scheduler: Scheduler, found: Sequence[Best], seconds: float,
           arguments: argparse.Namespace) -> None:
    out = console()
    out.print(f"{scheduler.config.title}: {len(found)} initial states in {seconds:.2f} s")
    table = Table(box=None, pad_edge=False)
    for heading in ("from", "least time per batch", "proof", "states", "this program",
                    f"earliest batch {arguments.batches}"):
        table.add_column(heading, no_wrap=True)
    for best in found:
        table.add_row(*_cells(best, scheduler.scheduling.counted, arguments.batches))
    out.print(table)
    for best in found:
        for line in _notes(best):
            out.print(line)
    if len(found) == 1:
        starts = found[0].batch_starts_s(scheduler.scheduling.counted)
        more = f" … ({len(starts)} in all)" if len(starts) > _SHOWN else ""
        out.print("batches start at " + ", ".join(f"{s:g}" for s in starts[:_SHOWN]) + more + " s")
    for path in (arguments.emit, arguments.gantt):
        if path:
            out.print(f"written: {path}")


def _cells(best: Best, counted: str, batches: int) -> tuple[str, ...]:
    starts = best.batch_starts_s(counted)
    last = f"{starts[-1]:g} s" if len(starts) >= batches else "never"
    if best.certificate is None:
        return best.case.name, "none", "", str(best.states), "", last
    proof = f"wrong: {best.flaw}" if best.flaw else "checked"
    return (best.case.name, f"{best.period_s:g} s", proof, f"{best.states:,}",
            _told(best.seconds(best.controller)), last)


def _told(seconds: float | None) -> str:
    return "none" if seconds is None else f"{seconds:g} s"


def _notes(best: Best) -> Iterator[str]:
    if best.certificate is None:
        yield f"{best.case.name}: nothing can be produced for ever: {best.reason}"
        return
    mine, least = best.seconds(best.controller), best.period_s
    if mine is None or least is None or mine == least:
        return
    yield (f"{best.case.name}: this program loses {mine - least:g} s per batch "
           f"({100 * (mine - least) / least:.1f} %)")
    if best.repair is not None:
        pairs = ", ".join(f"{a} before {b}" for a, b in best.repair.changes)
        told = best.seconds(best.repair.period)
        yield (f"  smallest change of its priorities: {pairs or 'none helps'}, then "
               f"{told:g} s; all {best.repair.tried} behaviours of fixed priorities were tried")


def _draw(scheduler: Scheduler, best: Best, path: Path) -> None:
    from plcemu.runtime.gantt import draw  # needs an extra
    users = scheduler.scheduling.users()
    draw(scheduler.timetable(best), users, float(best.unit_s),
         f"{scheduler.config.title}, {best.case.name}", path)
