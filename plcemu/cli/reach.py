"""`plcemu reach`: where the plant can get under the compiled program, exactly."""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from plcemu.base.errors import PlcemuError
from plcemu.cli.output import add_config_arguments, console, print_json
from plcemu.runtime.config import ConfigText
from plcemu.runtime.reach import Found, Question, study, within
from plcemu.runtime.reach_plot import Curve, save_plot
from plcemu.runtime.variation import parse_variation

HELP = "exact reachable intervals of the hybrid model under the compiled program"
EPILOG = """examples:
  plcemu reach il_programs/conveyor                                  # where it can stop
  plcemu reach il_programs/conveyor --vary cycle=5ms..15ms:100us --within 1.5
  plcemu reach il_programs/conveyor --study figure7 --plot figure7.svg

All numbers are exact: rationals, never rounded. Cycles vary freely within the jitter."""

_SHOWN = 40
"""Values of a study that are printed as a table; more go to --csv or --json."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    add_config_arguments(parser)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--vary", metavar="NAME=FROM..TO:STEP",
                      help="ask at every value of a parameter, such as cycle=1ms..15ms:10us")
    what.add_argument("--study", metavar="NAME",
                      help="a study of the configuration's section reach.studies")
    parser.add_argument("--objective", metavar="NAME",
                        help="the quantity asked about (default: the plant's first)")
    parser.add_argument("--within", metavar="WIDTH", type=_number,
                        help="tell the values at which the range is at most this")
    parser.add_argument("--csv", metavar="FILE", type=Path, help="write a row for each value")
    parser.add_argument("--plot", metavar="FILE", type=Path,
                        help="draw the study (.svg, .png or .pdf; needs plcemu[plot])")
    parser.add_argument("--jobs", metavar="N", type=int, default=os.cpu_count() or 1,
                        help="processes to use (default: all cores)")


def _number(text: str) -> Fraction:
    try:
        return Fraction(text)
    except (ValueError, ZeroDivisionError):
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from None


def execute(arguments: argparse.Namespace) -> int:
    """Compute, and return 1 if anything could not be concluded."""
    text = ConfigText.read(arguments.config)
    config = text.config(arguments.overrides)
    overrides, vary, limit = list(arguments.overrides), arguments.vary, arguments.within
    title = config.title
    show: Literal["interval", "range"] = "range"
    if arguments.study is not None:
        section = config.reach.study(arguments.study)
        if section is None:
            known = ", ".join(config.reach.studies) or "none"
            raise config.mistake(("reach", "studies"), f"there is no study {arguments.study!r}; "
                                 f"there is {known}")
        overrides += section.set
        vary, show, title = section.vary, section.show, section.title or arguments.study
        limit = section.within if limit is None else limit
    if vary is None:
        return _one(arguments, Question(text, overrides, arguments.objective))
    variation = parse_variation(vary)
    question = Question(text, overrides, arguments.objective)
    answers = _with_progress(lambda told: study(text, overrides, variation, arguments.objective,
                                                arguments.jobs, told))
    document = _document(question, variation.name, answers, limit)
    if arguments.csv is not None:
        _write_csv(arguments.csv, question, variation.name, answers)
    if arguments.plot is not None:
        save_plot(arguments.plot, Curve(title, variation.name, f"{question.objective}",
                                        question.unit, show, limit), answers)
    if arguments.json:
        print_json(document)
    else:
        _print_study(question, variation.name, answers, document)
    return 0 if all(a.conclusive for a in answers) else 1


def _with_progress(work: Callable[[Callable[[int, int], None] | None], list[Found]]) -> list[Found]:
    if not sys.stderr.isatty():
        return work(None)
    columns = (TextColumn("{task.completed}/{task.total} values"), BarColumn(),
               TimeRemainingColumn())
    with Progress(*columns, console=console(to_stderr=True), transient=True) as bar:
        row = bar.add_task("", total=None)
        return work(lambda done, of: bar.update(row, completed=done, total=of))


# ------------------------------------------------------------ one value


def _one(arguments: argparse.Namespace, question: Question) -> int:
    if arguments.csv is not None or arguments.plot is not None or arguments.within is not None:
        raise PlcemuError("--csv, --plot and --within belong to a study; add --vary or --study")
    found = question.at()
    if arguments.json:
        print_json({**_as_json(question, found), "reason": found.reason})
    else:
        _print_one(question, found)
    return 0 if found.conclusive else 1


def _print_one(question: Question, found: Found) -> None:
    out, unit = console(), question.unit
    if found.bounds is None:
        out.print(f"{question.objective}: is never reached")
    for n, piece in enumerate(found.pieces):
        what = question.objective if n == 0 else " " * len(question.objective)
        out.print(f"{what}: {_interval(piece)} {unit}")
    if found.range is not None:
        out.print(f"range: {float(found.range):.6g} {unit}, exactly {found.range}")
    if not found.conclusive:
        out.print(f"inconclusive: {found.reason}", style="bold red")


def _interval(piece: Any) -> str:
    low = "(-inf" if piece.low is None else \
        ("[" if piece.low_reached else "(") + f"{float(piece.low):.6f}"
    high = "inf)" if piece.high is None else \
        f"{float(piece.high):.6f}" + ("]" if piece.high_reached else ")")
    return f"{low}, {high}"


def _as_json(question: Question, found: Found) -> dict[str, Any]:
    """Return one answer as plain values; the keys carry the objective's name and unit."""
    unit = f"_{question.unit}" if question.unit else ""
    bounds, width = found.bounds, found.range
    ends = (None, None) if bounds is None else (bounds.low, bounds.high)
    return {
        f"{question.objective}{unit}": [_float(e) for e in ends] if bounds else None,
        f"range{unit}": _float(width),
        "exact": [None if e is None else f"{e.numerator}/{e.denominator}" for e in ends]
        if bounds else None,
        "reached": [bounds.low_reached, bounds.high_reached] if bounds else None,
        "pieces": [[_float(p.low), _float(p.high)] for p in found.pieces],
        "conclusive": found.conclusive, "states": found.states}


def _float(value: Fraction | None) -> float | None:
    return None if value is None else float(value)


# ------------------------------------------------------------ studies


def _document(question: Question, name: str, answers: list[Found],
              limit: Fraction | None) -> dict[str, Any]:
    document: dict[str, Any] = {
        "vary": name, "objective": question.objective, "unit": question.unit,
        "conclusive": all(a.conclusive for a in answers),
        "values": [{name: a.value, **_as_json(question, a)} for a in answers]}
    if limit is not None:
        document["within"] = {"limit": float(limit), "stretches": [
            [s.first, s.last] for s in within(answers, limit)]}
    return document


def _write_csv(file: Path, question: Question, name: str, answers: list[Found]) -> None:
    unit = f"_{question.unit}" if question.unit else ""
    try:
        with file.open("w", newline="", encoding="utf-8") as out:
            rows = csv.writer(out)
            rows.writerow([name, f"low{unit}", f"high{unit}", f"range{unit}", "exact_low",
                           "exact_high", "conclusive"])
            for a in answers:
                ends = (None, None) if a.bounds is None else (a.bounds.low, a.bounds.high)
                rows.writerow([a.value, *(_float(e) for e in ends), _float(a.range), *ends,
                               int(a.conclusive)])
    except OSError as problem:
        raise PlcemuError(f"{file}: {problem.strerror}") from None


def _print_study(question: Question, name: str, answers: list[Found],
                 document: dict[str, Any]) -> None:
    out = console()
    table = Table(box=None, pad_edge=False)
    for heading in (name, f"{question.objective} [{question.unit}]", f"range [{question.unit}]"):
        table.add_column(heading, justify="right")
    for a in answers[:_SHOWN]:
        width = "" if a.range is None else f"{float(a.range):.6g}"
        table.add_row(a.value, " ".join(map(_interval, a.pieces)) or "never", width)
    out.print(table)
    if len(answers) > _SHOWN:
        out.print(f"... and {len(answers) - _SHOWN} more; --csv FILE or --json has all")
    if "within" in document:
        told = document["within"]
        stretches = [a if a == b else f"{a} to {b}" for a, b in told["stretches"]]
        out.print(f"range at most {told['limit']:g} {question.unit} at {name} = "
                  f"{', '.join(stretches) or 'no value'}")
    unknown = [a.value for a in answers if not a.conclusive]
    if unknown:
        out.print(f"inconclusive at {len(unknown)} values, the first {unknown[0]}",
                  style="bold red")
