"""Every linear formula, judged by a network of nodes; and what its shape says of it."""

from __future__ import annotations

from collections.abc import Sequence

from plcemu.base.trace import Frame
from plcemu.monitor.bind import Binder, Values
from plcemu.monitor.build import Builder
from plcemu.monitor.formula import OPERATORS, Binary, Formula, Interval, Kind, Unary, walk
from plcemu.monitor.network import NextAtom, Node
from plcemu.monitor.signals import BEYOND, NO, UNSURE, YES
from plcemu.monitor.verdict import Obligation


class Shape:
    """What a formula demands again and again, and what puts it to the test.

    Attributes:
        repeated: whether the formula is G body.
        first_ns: the first instant that G looks at.
        body: what is demanded.
        premise: p, if the body is p -> q.
        bound_ns: b, if q or the body is F[a,b] r, or p -> that; None if there is none.
        counted: whose becoming true counts as a test; None counts changes instead.
    """

    def __init__(self, formula: Formula) -> None:
        self.repeated = isinstance(formula, Unary) and formula.op == "G"
        self.first_ns, self.body = 0, formula
        if isinstance(formula, Unary) and self.repeated:
            self.body = formula.arg
            self.first_ns = (formula.interval or Interval()).first_ns
        body = self.body
        conditional = isinstance(body, Binary) and body.op == "->"
        self.premise = body.left if isinstance(body, Binary) and conditional else None
        goal = body.right if isinstance(body, Binary) and conditional else body
        bounded = isinstance(goal, Unary) and goal.op == "F" and goal.interval
        self.bound_ns = goal.interval.last_ns if isinstance(goal, Unary) and bounded \
            and goal.interval else None
        again = self.repeated and isinstance(body, Unary) and body.op in ("F", "O")
        self.counted = body.arg if isinstance(body, Unary) and again else self.premise


class General:
    """Judges any linear formula; its attributes and methods are those of `Response`.

    `deadline_ns` is here the next instant at which to look: the verdict falls then or later.
    """

    def __init__(self, formula: Formula, binder: Binder) -> None:
        builder = Builder(binder.compile)
        self._shape = shape = Shape(formula)
        watched = [part for part in (shape.body, shape.counted) if part is not None]
        self.network = builder.network(formula, *watched)
        self.triggers = 0
        self.trigger_ns: int | None = None
        self.deadline_ns: int | None = None
        self._exact = True
        self._reach_ns = builder.reach_ns
        self._start_ns = 0
        self._t = self._changed = -1
        self._scan = 0
        self._ahead = 1
        self._body = builder.nodes[shape.body]
        self._counted: Node | None = builder.nodes.get(shape.counted) if shape.counted else None
        self._last_counted = -1
        # Said of the past, all but the root is known at every instant, and so nothing is owed.
        self._owes = not self._shape.repeated or any(
            isinstance(part, (Unary, Binary)) and (part.op == "X"
                                                   or OPERATORS[part.op].kind is Kind.FUTURE)
            for part in walk(shape.body))
        self.restless = self._owes
        self._unsure = False
        self._pulsed = any(atom.state.pulsed for atom in self.network.atoms)

    def step(self, frame: Frame, now: Values, before: Values, sure: bool) -> int | None:
        """Take the values from an instant on; before it lie the values `before`."""
        if self._t < 0:
            self._start_ns = frame.t_ns
        t = frame.t_ns - self._start_ns
        self.triggers += self._counted is None
        moved = self._take(t, frame.scan, now, before, sure)
        self._scan = frame.scan
        if not moved:
            return None
        verdict = self._settle()
        if verdict is None:
            # The next change will mostly come after about the same time as this one.
            self._ahead = max(1, 2 * (t - self._changed))
            self._t = self._changed = t
            self._foresee()
        return verdict

    def _take(self, t: int, scan: int, now: Values, before: Values, sure: bool) -> bool:
        """Hand the atoms their values; tell whether there was any news in them."""
        values = [atom.read(now, before, sure) for atom in self.network.atoms]
        if t and not self._pulsed and values == [atom.value for atom in self.network.atoms] \
                and not self.network.asks_next:
            return False
        for atom, value in zip(self.network.atoms, values, strict=True):
            if isinstance(atom, NextAtom):
                if t:
                    atom.reveal(t, value, scan == self._scan + 1)
                atom.last, atom.value = t - 1, atom.read(now, now, sure)
                continue
            if value == atom.value:
                atom.extend(t)
            else:
                atom.extend(t - 1)
                atom.decide(t, t, value)
            atom.last = t
            atom.value = atom.read(now, now, sure) if atom.state.pulsed else value
        return True

    def _settle(self) -> int | None:
        """Count, forget, and return the verdict if it has fallen."""
        self.network.settle()
        self._count()
        verdict = self.network.verdict()
        if verdict is None:
            self._unsure = self._unsure or any(
                value == UNSURE and end >= self._shape.first_ns
                for _, end, value in self._body.known)
            kept = {self._body: self._body.first}
            if self._counted is not None:
                # What was true just before would else be counted again where it goes on.
                kept[self._counted] = self._counted.first - 1
            self.network.forget(kept)
        elif verdict == NO:
            self.trigger_ns = self._first_broken()
        return verdict

    def _count(self) -> None:
        counted = self._counted
        if counted is None:
            return
        for start, _, value in counted.within(self._last_counted + 1, BEYOND):
            fresh = self._last_counted < start < counted.first
            if fresh and value == YES and (self._shape.repeated or start == 0):
                self.triggers += 1
                self._last_counted = start

    def _first_broken(self) -> int | None:
        if not self._shape.repeated:
            return self._start_ns
        broken = [max(start, self._shape.first_ns) for start, end, value in self._body.known
                  if value == NO and end >= self._shape.first_ns]
        return self._start_ns + broken[0] if broken else None

    # ------------------------------------------------------------ what time will decide

    def _foresee(self) -> None:
        """Find the next instant at which to look, `_ahead` ns from now or at the verdict."""
        if self._reach_ns == 0:
            self.deadline_ns, self._exact = None, True
            return
        horizon = self._t + 2 * self._reach_ns + 2
        look = min(self._t + self._ahead, horizon)
        if self.network.decided_by(look):
            self.deadline_ns, self._exact = self._start_ns + self._falls(self._t, look), True
        else:
            self._exact = look == horizon
            self.deadline_ns = None if self._exact else self._start_ns + look

    def _falls(self, early: int, late: int) -> int:
        """Return when the verdict falls: it is open at `early` and has fallen at `late`."""
        while late - early > 1:
            middle = (early + late) // 2
            early, late = (early, middle) if self.network.decided_by(middle) else (middle, late)
        return late

    def lapse(self, t_ns: int) -> tuple[int, int] | None:
        """Take it that nothing changed up to an instant that is not before the deadline.

        Returns:
            The verdict and the instant at which it fell, if it did.
        """
        assert self.deadline_ns is not None
        t, due = t_ns - self._start_ns, self.deadline_ns - self._start_ns
        if not self._exact and self.network.decided_by(t):
            due = self._falls(due - 1, t)
        elif not self._exact:
            due = t
        self.network.pass_time(due)
        verdict = self._settle()
        if verdict is not None:
            return verdict, self._start_ns + due
        self._ahead, self._t = 2 * max(1, due - self._t), due
        self._foresee()
        return None

    def exact_deadline_ns(self) -> int | None:
        """Return the first instant at which the verdict falls if nothing changes."""
        if not self._exact:
            assert self.deadline_ns is not None
            self._exact = True
            early = self.deadline_ns - self._start_ns
            horizon = self._t + 2 * self._reach_ns + 2
            self.deadline_ns = self._start_ns + self._galloped(early) \
                if self.network.decided_by(horizon) else None
        return self.deadline_ns

    def _galloped(self, early: int) -> int:
        stride = max(1, early - self._t)
        while not self.network.decided_by(early + stride):
            early, stride = early + stride, 2 * stride
        return self._falls(early, early + stride)

    # ------------------------------------------------------------ how it stands

    def presume(self, t_ns: int) -> int:
        """Return the verdict if the run ended with an instant."""
        if not self._owes:
            return UNSURE if self._unsure else YES
        return self.network.cut(t_ns - self._start_ns)

    def obligations(self, t_ns: int) -> Sequence[Obligation]:
        """Return the stretches on which the demand is still open, as the instants they begin."""
        if not self._shape.repeated or self._t < 0:
            return []
        # After the last change time passed without one: nothing new came to be owed.
        now, free = min(t_ns - self._start_ns, self._t), max(self._shape.first_ns, self._body.first)
        found: list[int] = []
        for start, end, _ in self._body.within(free, now):
            if free < start:
                found.append(free)
            free = max(free, end + 1)
        if free <= now:
            found.append(free)
        bound = self._shape.bound_ns
        return [Obligation(self._start_ns + t, None if bound is None
                           else self._start_ns + t + bound) for t in found]
