"""SPIN's opinion on what our own checker has judged, verdict by verdict."""

from __future__ import annotations

import re
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.verify.check import HOLDS, INCONCLUSIVE
from plcemu.verify.explore import Limits
from plcemu.verify.promela.model import PromelaModel
from plcemu.verify.promela.spin import Answer, Costs, Spin, tool
from plcemu.verify.prove import NO_FAULT, Prover, Result

STARTS = 100
"""Initial states that SPIN is asked about one by one; of more, only about all together."""


@dataclass(slots=True)
class Row:
    """Two verdicts on one property.

    Attributes:
        name: of the property.
        initial: the initial state that the verdicts are about; empty for all together.
        ours: our verdict.
        answer: SPIN's, with the counterexample that it found.
    """

    name: str
    initial: str
    ours: str
    answer: Answer

    @property
    def asked(self) -> bool:
        """Whether SPIN can be asked at all."""
        return not self.answer.question.why_not

    @property
    def differs(self) -> bool:
        """Whether both have a verdict, and not the same one."""
        verdicts = {self.ours, self.answer.verdict}
        return len(verdicts) == 2 and INCONCLUSIVE not in verdicts


@dataclass(slots=True)
class Opinion:
    """All verdicts of SPIN beside ours, and what they took."""

    version: str
    rows: list[Row]
    costs: Costs = field(default_factory=Costs)

    @property
    def differs(self) -> list[Row]:
        """Where the verdicts are not the same."""
        return [row for row in self.rows if row.differs]

    @property
    def undecided(self) -> list[Row]:
        """Where SPIN was asked and came to no verdict."""
        return [row for row in self.rows if row.asked and row.answer.verdict == INCONCLUSIVE]

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        rows = []
        for row in self.rows:
            path = row.answer.path
            rows.append({"name": row.name, "initial": row.initial, "asked": row.asked,
                         "verdict": row.answer.verdict, "reason": row.answer.reason,
                         "agrees": not row.differs,
                         "found": None if path is None else path.as_json()})
        return {"version": self.version, "agrees": not self.differs, "verdicts": rows,
                "searches": self.costs.searches, "states": self.costs.states,
                "seconds": {k: round(v, 3) for k, v in self.costs.seconds.items()}}


def promela_of(prover: Prover, result: Result, title: str,
               header_name: str = "plant.h") -> PromelaModel:
    """Return the Promela model of a closed loop that was explored.

    Raises:
        PlcemuError: the exploration is not complete, or Promela cannot say something that matters.
    """
    if not result.graph.complete:
        raise PlcemuError("no model for SPIN: the plant's tables would not be complete, because "
                          f"{result.graph.reason}; raise verify.limits")
    return PromelaModel(prover, result.graph, title, header_name)


def ask_spin(prover: Prover, result: Result, title: str,
             limits: Limits = Limits()) -> Opinion:  # noqa: B008
    """Let SPIN judge what was proved, from each initial state if there are not too many.

    Raises:
        PlcemuError: SPIN is not there, the model cannot be made, or a counterexample of SPIN is
            none when our closed loop executes it.
    """
    version = spin_version()
    model = promela_of(prover, result, title)
    initial = model.tables.initial
    starts: list[int | None] = [None] if not 1 < len(initial) <= STARTS else [
        *range(len(initial))]
    with tempfile.TemporaryDirectory(prefix="plcemu-spin-") as folder:
        spin = Spin(model, Path(folder), limits)
        rows = []
        for start in starts:
            name = "" if start is None else prover.loop.plant.name_of(initial[start])
            rows += [Row(a.question.name, name, _ours(result, a.question.name, name), a)
                     for a in spin.judge(prover, start)]
        return Opinion(version, _joined(rows), spin.costs)


def _joined(rows: list[Row]) -> list[Row]:
    """Join the rows of what is wanted from some initial state only: found from one, it holds."""
    found: dict[str, Row] = {}
    for row in rows:
        if row.answer.question.holds_if_found and row.asked:
            before = found.setdefault(row.name, Row(row.name, "", row.ours, row.answer))
            if before.answer.verdict != HOLDS and row.answer.verdict in (HOLDS, INCONCLUSIVE):
                before.answer = row.answer
    return [row for row in rows if row.name not in found] + list(found.values())


def spin_version() -> str:
    """Return which SPIN is installed; raises SpinError if none is."""
    told = subprocess.run([tool("spin"), "-V"], capture_output=True, text=True, timeout=30,
                          check=False).stdout
    found = re.search(r"Version ([\d.]+)", told)
    return found[1] if found else "of unknown version"


def _ours(result: Result, name: str, initial: str) -> str:
    """Return our verdict on a property, from one initial state if it is named."""
    proof = next((p for p in result.proofs if p.name == name), None)
    if proof is None:
        return HOLDS if name == NO_FAULT else INCONCLUSIVE
    if proof.finding.verdict == HOLDS or not initial:
        return proof.finding.verdict
    if proof.initial:
        return proof.initial[initial]
    return INCONCLUSIVE  # what is violated from some initial state says nothing of this one
