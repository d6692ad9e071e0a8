"""What `plcemu verify --spin` and `--promela` print."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from rich.table import Table

from plcemu.cli.output import console
from plcemu.runtime.second_opinion import Opinion, promela_of
from plcemu.verify.prove import Prover, Result

_SHOWN = 6
"""Properties that are named with a reason before the rest is counted."""


def write_promela(file: Path, prover: Prover, result: Result, title: str) -> list[str]:
    """Write the model; return lines that say so, and how it is run."""
    model = promela_of(prover, result, title, f"{file.stem}.plant.h")
    header = model.write(file)
    told = [f"written: {file} and {header}; its head says how it is run"]
    not_asked = [(q.name, q.why_not) for q in model.questions if q.why_not]
    return told + [f"  not asked of SPIN: {line}" for line in _by_reason(not_asked)]


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
    silent = [(row.name, row.answer.reason) for row in opinion.rows if row.answer.reason]
    for line in _by_reason(silent):
        out.print(f"  no verdict of SPIN on {line}")
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


def _by_reason(rows: list[tuple[str, str]]) -> list[str]:
    """Return names and reasons, names of one reason together, and not too many of them."""
    reasons: dict[str, dict[str, None]] = {}
    for name, reason in rows:
        reasons.setdefault(reason, {})[name] = None
    lines = []
    for reason, names in reasons.items():
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        lines.append(f"{', '.join(list(names)[:_SHOWN])}{more}: {reason}")
    return lines


def _counted(verdicts: list[str]) -> str:
    """Return one verdict as it is, several as how many of each."""
    if len(verdicts) == 1:
        return verdicts[0]
    return ", ".join(f"{n} {verdict}" for verdict, n in sorted(Counter(verdicts).items()))
