"""One property under watch: its evaluator, its verdict and the story of its violation."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from plcemu.base.errors import LimitError
from plcemu.base.tags import TagTable
from plcemu.base.trace import Frame
from plcemu.base.types import Value
from plcemu.monitor.bind import Binder, Values
from plcemu.monitor.evaluators import body_of, make_evaluator, premise_of
from plcemu.monitor.formula import Binary, Formula, Unary, is_state, tag_refs, walk
from plcemu.monitor.parse import Property
from plcemu.monitor.verdict import FINAL, PRESUMED, Result, Verdict, Violation

RECENT = 20
"""The largest number of changes told in the story of a violation."""


class Watch:
    """Judges one property; knows when it is decided and why.

    Attributes:
        tags_used: the indices of the formula's tags.
        deadline_ns: the first instant at which the verdict falls if nothing changes.
        verdict: the final verdict; None while it is open.
    """

    def __init__(self, entry: Property, formula: Formula, tags_used: list[int], binder: Binder,
                 ) -> None:
        self.entry = entry
        self.tags_used = tags_used
        self.deadline_ns: int | None = None
        self.verdict: Verdict | None = None
        self._formula, self._binder = formula, binder
        self._evaluator = make_evaluator(formula, binder)
        self._recent: deque[Frame] = deque(maxlen=RECENT)
        self._decided_at_ns: int | None = None
        self._violation: Violation | None = None
        self._reason = ""

    @property
    def fixed(self) -> list[object]:
        """What never changes, so that copies of the watch can share it."""
        return [self.entry, self._binder, *walk(self.entry.formula), *walk(self._formula),
                *self._recent]

    def start(self, frame: Frame, values: Values) -> None:
        """Take the first frame; every tag of the formula must have a value in it."""
        missing = [self._binder.tags[i].name for i in self.tags_used if values[i] is None]
        if missing:
            self._give_up(frame.t_ns, f"the first frame has no value of {', '.join(missing)}")
        else:
            self.step(frame, values, values)

    def step(self, frame: Frame, now: Values, before: Values) -> None:
        """Take a frame in which a tag of the formula changed."""
        self._recent.append(frame)
        try:
            verdict = self._evaluator.step(frame.t_ns, now, before)
        except (ArithmeticError, TypeError, LimitError) as error:
            self._give_up(frame.t_ns, str(error))
            return
        self.deadline_ns = self._evaluator.deadline_ns
        if verdict is not None:
            self._decide(verdict, frame.t_ns, now)

    def expire(self, now: Values) -> None:
        """Take the verdict that falls at the deadline, which has passed without a change."""
        assert self.deadline_ns is not None
        self._decide(self._evaluator.expire(), self.deadline_ns, now)

    def stands(self, t_ns: int | None) -> Verdict:
        """Return the verdict at an instant; None before the first frame."""
        if self.verdict is not None:
            return self.verdict
        if t_ns is None:
            return Verdict.INCONCLUSIVE
        return PRESUMED[self._evaluator.presume(t_ns)]

    def result(self, t_ns: int | None) -> Result:
        """Return how the property stands at an instant; None before the first frame."""
        verdict = self.stands(t_ns)
        reason = "there was no frame" if self.verdict is None and t_ns is None else self._reason
        triggers = self._evaluator.triggers
        tested = triggers > 0 or premise_of(self._formula) is None
        return Result(self.entry.name, str(self.entry.formula), self.entry.description, verdict,
                      triggers, self._decided_at_ns, not tested, self._violation, reason)

    def _give_up(self, t_ns: int, reason: str) -> None:
        self.verdict, self._decided_at_ns, self._reason = Verdict.INCONCLUSIVE, t_ns, reason
        self.deadline_ns = None

    def _decide(self, verdict: bool, t_ns: int, now: Values) -> None:
        self.verdict, self._decided_at_ns, self.deadline_ns = FINAL[verdict], t_ns, None
        if not verdict:
            tags = self._binder.tags
            names = blamed(body_of(self._formula), self._binder, now)
            self._violation = Violation(
                self._evaluator.trigger_ns, t_ns,
                tuple((tags[i].name, now[i]) for i in names),
                recent_changes(self._recent, tags, frozenset(self.tags_used)))


def blamed(formula: Formula, binder: Binder, now: Values) -> list[int]:
    """Return the tags that break a demand, the nearest to blame first.

    Of a conjunction of states only the broken parts are to blame; of p -> q the tags of q come
    before those of p.
    """
    parts = [formula]
    if isinstance(formula, Binary) and formula.op == "->":
        parts = [formula.right, formula.left]
    elif isinstance(formula, Binary) and formula.op == "&" and is_state(formula):
        broken = [part for part in (formula.left, formula.right)
                  if not binder.compile(part).holds(now, now)]
        parts = broken or [formula.left, formula.right]
    if parts == [formula]:
        inner = formula.arg if isinstance(formula, Unary) else formula
        return [binder.tags.find(ref.name) for ref in tag_refs(inner)]
    return list(dict.fromkeys(i for part in parts for i in blamed(part, binder, now)))


def recent_changes(frames: Sequence[Frame], tags: TagTable, wanted: frozenset[int],
                   ) -> tuple[tuple[int, str, Value], ...]:
    """Return the last changes of the wanted tags as (t_ns, tag, value), oldest first."""
    rows = [(frame.t_ns, tags[index].name, value)
            for frame in frames for index, value in frame.changes if index in wanted]
    return tuple(rows[-RECENT:])
