"""What `plcemu verify --spin` and `--promela` print."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from rich.table import Table

from plcemu.cli.output import console
from plcemu.runtime.second_opinion import Opinion, promela_of
from plcemu.verify.prove import Prover, Result

_SHOWN = 6
"""Verdicts of different kinds on initial states that are named before the rest is counted."""


def write_promela(file: Path, prover: Prover, result: Result, title: str) -> list[str]:
    """Write the model; return lines that say so, and how it is run."""
    model = promela_of(prover, result, title, f"{file.stem}.plant.h")
    header = model.write(file)
    told = [f"written: {file} and {header}; its head says how it is run"]
    return told + [f"  not asked of SPIN: {q.name}: {q.why_not}"
                   for q in model.questions if q.why_not]


def print_opinion(opinion: Opinion) -> None:
    """Print SPIN's verdicts beside ours."""
    out, costs = console(), opinion.costs
    asked = [row for row in opinion.rows if row.asked]
    times = ", ".join(f"{what} {seconds:.2f} s" for what, seconds in costs.seconds.items())
    out.print(f"\nSPIN {opinion.version}: {times}; {costs.searches} searches, "
              f"{costs.states:,} states")
    table = Table(box=None, pad_edge=False)
    for heading in ("property", "SPIN", "plcemu"):
        table.add_column(heading, no_wrap=True)
    names = list(dict.fromkeys(row.name for row in asked))
    for name in names:
        rows = [row for row in asked if row.name == name]
        differs = any(row.differs for row in rows)
        table.add_row(name, _counted([r.answer.verdict for r in rows]),
                      _counted([r.ours for r in rows]) + ("  DIFFERS" if differs else ""),
                      style="bold red" if differs else "")
    out.print(table)
    reasons: dict[str, list[str]] = {}
    for row in opinion.rows:
        if row.answer.reason:
            reasons.setdefault(row.answer.reason, []).append(row.name)
    for reason, of in reasons.items():
        few = list(dict.fromkeys(of))
        more = f" and {len(few) - _SHOWN} more" if len(few) > _SHOWN else ""
        out.print(f"  no verdict of SPIN on {', '.join(few[:_SHOWN])}{more}: {reason}")
    found = [row for row in asked if row.answer.path is not None]
    if found:
        out.print(f"  {len(found)} of SPIN's trails executed again by plcemu: each shows what "
                  "SPIN says")
    for row in opinion.differs:
        where = f" from {row.initial}" if row.initial else ""
        out.print(f"{row.name}{where}: SPIN says {row.answer.verdict}, plcemu {row.ours}",
                  style="bold red")
        if row.answer.path is not None:
            for line in row.answer.path.lines():
                out.print(line)


def _counted(verdicts: list[str]) -> str:
    """Return one verdict as it is, several as how many of each."""
    if len(verdicts) == 1:
        return verdicts[0]
    return ", ".join(f"{n} {verdict}" for verdict, n in sorted(Counter(verdicts).items()))
