"""What a monitor says: the verdict, and the story of a violation."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from plcemu.base.time import NS_PER_S
from plcemu.base.types import Value


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


FINAL = {True: Verdict.SATISFIED, False: Verdict.VIOLATED}
PRESUMED = {True: Verdict.PRESUMABLY_SATISFIED, False: Verdict.PRESUMABLY_VIOLATED}


@dataclass(frozen=True, slots=True)
class Violation:
    """The story of a violation.

    Attributes:
        trigger_ns: the instant whose demand was not met; None where the formula has no such one.
        decided_at_ns: the first instant at which nothing could mend it.
        blamed: the tags that did not do what was demanded, and their values at the decision.
        recent: the last changes of the formula's tags before the decision, oldest first, as
            (t_ns, tag, value); at most `plcemu.monitor.watch.RECENT`.
    """

    trigger_ns: int | None
    decided_at_ns: int
    blamed: tuple[tuple[str, Value | None], ...]
    recent: tuple[tuple[int, str, Value], ...]

    def as_json(self) -> dict[str, object]:
        """Return the story as plain values, times in s."""
        return {"trigger_s": _seconds(self.trigger_ns),
                "decided_at_s": _seconds(self.decided_at_ns),
                "blamed": dict(self.blamed),
                "recent": [{"t_s": _seconds(t), "tag": tag, "value": value}
                           for t, tag, value in self.recent]}


@dataclass(frozen=True, slots=True)
class Result:
    """What became of one property.

    Attributes:
        name: of the property.
        formula: as text.
        description: in the user's words; may be empty.
        verdict: one of the five.
        triggers: how often the property was put to the test: for G (p -> q) how often p became
            true, for G F q how often q did, else how many changes of its tags were judged.
        decided_at_ns: the first instant at which the verdict was final; None while it is not.
        vacuous: whether a premise stands in the formula and was never true.
        violation: the story, if it is violated.
        reason: why it is inconclusive; else empty.
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

    @property
    def failed(self) -> bool:
        """Whether the property is violated, finally."""
        return self.verdict is Verdict.VIOLATED

    def as_json(self) -> dict[str, object]:
        """Return the result as plain values, times in s."""
        return {"name": self.name, "formula": self.formula, "description": self.description,
                "verdict": self.verdict.value, "triggers": self.triggers,
                "decided_at_s": _seconds(self.decided_at_ns), "vacuous": self.vacuous,
                "violation": self.violation.as_json() if self.violation else None,
                "reason": self.reason}


def _seconds(t_ns: int | None) -> float | None:
    return None if t_ns is None else t_ns / NS_PER_S
