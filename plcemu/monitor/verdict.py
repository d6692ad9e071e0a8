"""What a monitor says: the verdict, and the story of a violation."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from plcemu.base.time import NS_PER_S, format_duration
from plcemu.base.trace import Trace
from plcemu.base.types import Value
from plcemu.monitor.parse import Severity
from plcemu.monitor.signals import NO, UNSURE, YES


class Verdict(enum.StrEnum):
    """Four values of RV-LTL (Bauer, Leucker, Schallhart, 2010), and one for no answer.

    Satisfied and violated are final: no continuation of the run changes them. *Presumably* says
    how the formula stands if the run ended at the cut: an obligation that is still unmet there,
    with its deadline to come or without one, makes it presumably violated; if none is unmet,
    it is presumably satisfied. There p U[a,b] q is two demands, p until a and p U[0,b-a] q from
    then on; what is certain to come counts as met.
    """

    SATISFIED = "satisfied"
    VIOLATED = "violated"
    PRESUMABLY_SATISFIED = "presumably satisfied"
    PRESUMABLY_VIOLATED = "presumably violated"
    INCONCLUSIVE = "inconclusive"


FINAL = {NO: Verdict.VIOLATED, UNSURE: Verdict.INCONCLUSIVE, YES: Verdict.SATISFIED}
PRESUMED = {NO: Verdict.PRESUMABLY_VIOLATED, UNSURE: Verdict.INCONCLUSIVE,
            YES: Verdict.PRESUMABLY_SATISFIED}


@dataclass(frozen=True, slots=True)
class Obligation:
    """Something that is still owed.

    Attributes:
        trigger_ns: since when.
        deadline_ns: until when it must be met; None if there is no such instant, or not a single
            one.
    """

    trigger_ns: int
    deadline_ns: int | None

    def as_json(self, t_ns: int) -> dict[str, object]:
        """Return it as plain values at an instant, times in s."""
        left = None if self.deadline_ns is None else max(0, self.deadline_ns - t_ns)
        return {"trigger_s": _seconds(self.trigger_ns), "deadline_s": _seconds(self.deadline_ns),
                "remaining_s": _seconds(left)}


@dataclass(frozen=True, slots=True)
class Violation:
    """The story of a violation.

    Attributes:
        trigger_ns: the instant whose demand was not met; None where the formula has no such one.
        decided_at_ns: the first instant at which nothing could mend it.
        blamed: the tags that did not do what was demanded, and their values at the decision.
        recent: the last changes of the formula's tags before the decision, oldest first, as
            (t_ns, tag, value); at most `plcemu.monitor.watch.RECENT`.
        scans: the same with scan numbers and values as they are read.
        excerpt: the last frames of all tags before the decision as a trace of its own, which
            replays; it ends at the decision.
    """

    trigger_ns: int | None
    decided_at_ns: int
    blamed: tuple[tuple[str, Value | None], ...]
    recent: tuple[tuple[int, str, Value | None], ...]
    scans: tuple[ScanRow, ...] = ()
    excerpt: Trace | None = None

    def as_json(self) -> dict[str, object]:
        """Return the story as plain values, times in s."""
        return {"trigger_s": _seconds(self.trigger_ns),
                "decided_at_s": _seconds(self.decided_at_ns),
                "blamed": dict(self.blamed),
                "recent": [{"t_s": _seconds(t), "tag": tag, "value": value}
                           for t, tag, value in self.recent],
                "scans": [{"scan": row.scan, "t_s": _seconds(row.t_ns), "changes": row.changes}
                          for row in self.scans],
                "table": self.table()}

    def table(self) -> str:
        """Return the last scans before the decision as a table of the changes in them."""
        names = list(dict.fromkeys(name for row in self.scans for name in row.changes))
        rows = [["scan", "t", *names]]
        rows += [[str(row.scan), format_duration(row.t_ns),
                  *(row.changes.get(name, "") for name in names)] for row in self.scans]
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
                 for row in rows]
        return "\n".join(line.rstrip() for line in lines)


@dataclass(frozen=True, slots=True)
class ScanRow:
    """What changed in one scan: tags and their values as they are read."""

    scan: int
    t_ns: int
    changes: dict[str, str]


@dataclass(frozen=True, slots=True)
class Result:
    """What became of one property.

    Attributes:
        name: of the property.
        formula: as text.
        description: in the user's words; may be empty.
        verdict: one of the five.
        triggers: how often the property was put to the test: for G (p -> q) how often p became
            true, for G F q and G O q how often q did, else how many changes of its tags were
            judged.
        decided_at_ns: the first instant at which the verdict was final; None while it is not.
        vacuous: whether a premise stands in the formula and was never true.
        violation: the story, if it is violated.
        reason: why it is inconclusive; else empty.
        severity: of the property.
        pattern: the pattern that it was stated by; empty for a formula.
        meaning: what the pattern demands; empty for a formula.
        robustness: for numeric formulas how far the nearest miss was from violating it, in the
            unit of the compared values, negative if it is violated; else None.
        obligations: what is still owed, oldest first.
        t_ns: the instant at which it stands so.
    """

    name: str
    formula: str
    description: str
    verdict: Verdict
    triggers: int = 0
    decided_at_ns: int | None = None
    vacuous: bool = False
    violation: Violation | None = None
    reason: str = ""
    severity: Severity = Severity.ERROR
    pattern: str = ""
    meaning: str = ""
    robustness: float | None = None
    obligations: tuple[Obligation, ...] = ()
    t_ns: int = 0

    @property
    def failed(self) -> bool:
        """Whether the property is violated, finally, and that is an error or worse."""
        return self.verdict is Verdict.VIOLATED and self.severity.fails

    def as_json(self) -> dict[str, object]:
        """Return the result as plain values, times in s."""
        return {"name": self.name, "formula": self.formula, "description": self.description,
                "severity": self.severity.value, "pattern": self.pattern, "meaning": self.meaning,
                "verdict": self.verdict.value, "triggers": self.triggers,
                "decided_at_s": _seconds(self.decided_at_ns), "vacuous": self.vacuous,
                "robustness": self.robustness,
                "obligations": [o.as_json(self.t_ns) for o in self.obligations],
                "violation": self.violation.as_json() if self.violation else None,
                "reason": self.reason}


def _seconds(t_ns: int | None) -> float | None:
    return None if t_ns is None else t_ns / NS_PER_S
