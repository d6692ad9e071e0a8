"""One property under watch: its evaluator, its verdict and the story of its violation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence

from plcemu.base.errors import LimitError
from plcemu.base.tags import TagTable
from plcemu.base.time import format_duration
from plcemu.base.trace import Frame, Trace
from plcemu.base.types import Value
from plcemu.monitor.bind import Binder, Values
from plcemu.monitor.evaluators import Evaluator, body_of, make_evaluator, premise_of
from plcemu.monitor.formula import Binary, Formula, Unary, is_state, walk
from plcemu.monitor.margin import margin_of
from plcemu.monitor.parse import Property
from plcemu.monitor.signals import NO
from plcemu.monitor.verdict import FINAL, PRESUMED, Result, ScanRow, Verdict, Violation

RECENT = 20
"""The largest number of changes told in the story of a violation."""

_GIVES_UP = (ArithmeticError, TypeError, LookupError, LimitError)


class Watch:
    """Judges one property; knows when it is decided and why.

    Attributes:
        tags_used: the indices of the values that the formula reads.
        place: its number in the suite.
        every_frame: whether it must see every frame, not only those that change its tags.
        deadline_ns: an instant before which time alone decides nothing; None if it never does.
        verdict: the final verdict; None while it is open.
    """

    def __init__(self, entry: Property, formula: Formula, binder: Binder, place: int = 0) -> None:
        self.entry, self.place = entry, place
        self.tags_used = binder.used(formula)
        self.every_frame = any(isinstance(part, Unary) and part.op == "X"
                               for part in walk(formula))
        self.deadline_ns: int | None = None
        self.verdict: Verdict | None = None
        self._formula, self._binder = formula, binder
        self.use(make_evaluator(formula, binder))
        self._margin = margin_of(formula, binder)
        self._recent: deque[Frame] = deque(maxlen=RECENT)
        self._decided_at_ns: int | None = None
        self._violation: Violation | None = None
        self._reason = ""

    @property
    def restless(self) -> bool:
        """Whether it may stand otherwise after some time in which nothing changed."""
        return self._evaluator.restless

    @property
    def fixed(self) -> list[object]:
        """What never changes, so that copies of the watch can share it."""
        return [self.entry, self._binder, *walk(self.entry.formula), *walk(self._formula),
                *self._recent]

    def use(self, evaluator: Evaluator) -> None:
        """Let an evaluator judge the formula."""
        self._evaluator = evaluator
        self._step = evaluator.step

    def step(self, frame: Frame, now: Values, before: Values, sure: bool) -> bool:
        """Take a frame in which a tag of the formula changed.

        Returns:
            Whether the verdict fell or the deadline moved.
        """
        self._recent.append(frame)
        evaluator = self._evaluator
        try:
            verdict = self._step(frame, now, before, sure)
            if self._margin is not None:
                self._margin.step(now, before, sure)
        except _GIVES_UP as error:
            self.give_up(frame.t_ns, str(error))
            return True
        if not sure and not self._reason:
            self._note_unknown(frame, now, before)
        if verdict is not None:
            self._decide(verdict, frame.t_ns, now)
            return True
        if self.deadline_ns == evaluator.deadline_ns:
            return False
        self.deadline_ns = evaluator.deadline_ns
        return True

    def lapse(self, t_ns: int, now: Values) -> None:
        """Take it that nothing changed up to an instant that is not before the deadline."""
        try:
            fallen = self._evaluator.lapse(t_ns)
        except _GIVES_UP as error:
            self.give_up(t_ns, str(error))
            return
        if fallen is None:
            self.deadline_ns = self._evaluator.deadline_ns
        else:
            self._decide(*fallen, now)

    def exact_deadline_ns(self) -> int | None:
        """Return the first instant at which the verdict falls if nothing changes."""
        if self.verdict is not None:
            return None
        self.deadline_ns = self._evaluator.exact_deadline_ns()
        return self.deadline_ns

    def stands(self, t_ns: int | None) -> Verdict:
        """Return the verdict at an instant; None before the first frame."""
        if self.verdict is not None:
            return self.verdict
        if t_ns is None:
            return Verdict.INCONCLUSIVE
        return PRESUMED[self._evaluator.presume(t_ns)]

    def result(self, t_ns: int | None) -> Result:
        """Return how the property stands at an instant; None before the first frame."""
        entry, stated = self.entry, self.entry.stated
        verdict = self.stands(t_ns)
        reason = self._reason if verdict is Verdict.INCONCLUSIVE else ""
        reason = "there was no frame" if t_ns is None else reason
        triggers = self._evaluator.triggers
        tested = triggers > 0 or premise_of(self._formula) is None
        owed = () if t_ns is None or self.verdict is not None else \
            tuple(self._evaluator.obligations(t_ns))
        return Result(
            entry.name, str(entry.formula), entry.description, verdict, triggers,
            self._decided_at_ns, not tested, self._violation, reason, entry.severity,
            stated.pattern if stated else "", stated.meaning if stated else "",
            self._margin.value if self._margin else None, owed, t_ns or 0)

    def tell(self, excerpt: Callable[[int], Trace]) -> None:
        """Add the excerpt to the story of a fresh violation."""
        story = self._violation
        if story is not None and story.excerpt is None:
            self._violation = Violation(story.trigger_ns, story.decided_at_ns, story.blamed,
                                        story.recent, story.scans, excerpt(story.decided_at_ns))

    def give_up(self, t_ns: int, reason: str) -> None:
        """Answer that the question cannot be answered."""
        self.verdict, self._decided_at_ns, self._reason = Verdict.INCONCLUSIVE, t_ns, reason
        self.deadline_ns = None

    def _note_unknown(self, frame: Frame, now: Values, before: Values) -> None:
        """Remember which value was missed first."""
        tags = self._binder.tags
        missing = [tags[i].name for i in self.tags_used
                   if i < len(tags) and (now[i] is None or before[i] is None)]
        names = ", ".join(missing)
        self._reason = f"the first frame has no value of {names}" if len(self._recent) == 1 \
            else f"{names} had no valid value at {format_duration(frame.t_ns)}"

    def _decide(self, verdict: int, t_ns: int, now: Values) -> None:
        self.verdict, self._decided_at_ns, self.deadline_ns = FINAL[verdict], t_ns, None
        if verdict == NO:
            tags = self._binder.tags
            names = [i for i in blamed(body_of(self._formula), self._binder, now) if i < len(tags)]
            used = frozenset(self.tags_used)
            self._violation = Violation(
                self._evaluator.trigger_ns, t_ns,
                tuple((tags[i].name, now[i]) for i in names),
                recent_changes(self._recent, tags, used),
                tuple(scan_rows(self._recent, tags, used)))


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
                  if not binder.compile(part).kleene(now, now)]
        parts = broken or [formula.left, formula.right]
    if parts == [formula]:
        inner = formula.arg if isinstance(formula, Unary) else formula
        return binder.used(inner)
    return list(dict.fromkeys(i for part in parts for i in blamed(part, binder, now)))


def recent_changes(frames: Sequence[Frame], tags: TagTable, wanted: frozenset[int],
                   ) -> tuple[tuple[int, str, Value | None], ...]:
    """Return the last changes of the wanted tags as (t_ns, tag, value), oldest first."""
    rows = [(frame.t_ns, tags[index].name, value) for frame in frames
            for index, value in frame.changes if index in wanted and index < len(tags)]
    return tuple(rows[-RECENT:])


def scan_rows(frames: Iterable[Frame], tags: TagTable, wanted: frozenset[int],
              ) -> Iterable[ScanRow]:
    """Yield for each scan what changed in it, in the user's names and values."""
    for frame in frames:
        changes = {tags[i].name: tags[i].shown(value) for i, value in frame.changes
                   if i in wanted and i < len(tags)}
        if changes:
            yield ScanRow(frame.scan, frame.t_ns, changes)
