"""Many steps of the closed loop at once: each round makes one scan of every step that goes on.

What a step is says `plcemu.verify.settle`; this comes to the same states with fewer crossings
between Python and the engine.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from functools import partial
from itertools import islice

from plcemu.verify.settle import (
    SETTLES_WITHIN,
    DoesNotSettle,
    Settling,
    Start,
    State,
    reason_of,
)

MOST = 128
"""Steps made together; with more, what is known of them outgrows the processor's cache."""

_state: Callable[[tuple[bytes, Hashable, int, str, tuple[int, ...]]], State]
_state = partial(tuple.__new__, State)  # as State(...), in half the time


class Rounds(Settling):
    """Makes steps together."""

    def settled(self, starts: Iterable[Start], elapsed_ns: int) -> Iterator[State]:
        """Yield the states that steps lead to, in their order.

        Raises:
            DoesNotSettle: the next one leads to none.
        """
        starts = iter(starts)
        while some := list(islice(starts, min(MOST, self.views.batch.capacity))):
            for state in self._rounds(some, elapsed_ns):
                if state is None:
                    raise DoesNotSettle
                yield state

    def _rounds(self, starts: list[Start], elapsed_ns: int) -> list[State | None]:
        """Return the states; None for those that do not settle."""
        batch, outcome, once = self.views.batch, self.views.outcome, self.once
        batch.load([memory for memory, _ in starts])
        views = [self.views.of(plant) for _, plant in starts]
        seen, faults = [0] * len(starts), [""] * len(starts)
        going, at_once = list(range(len(starts))), []
        for scan in range(SETTLES_WITHIN):
            if not going:
                break
            ran = batch.run(going, [views[n].packed for n in going], elapsed_ns)
            self.machine.scans += len(going) - len(ran.faults)
            goes_on = []
            for at, (n, told, changed) in enumerate(zip(going, ran.told, ran.changed, strict=True)):
                if ran.faults and at in ran.faults:
                    faults[n] = reason_of(ran.faults[at])
                    at_once += [n] if scan == 0 else []
                    continue
                view = views[n]
                holding, following = view.outcomes.get(told) or outcome(view, told)
                seen[n] |= holding
                if following is not view:
                    views[n] = following
                elif not changed:
                    continue
                if not once:
                    goes_on.append(n)
            going = goes_on
        found: list[State | None] = [
            _state((memory, view.state, bits & self.told, fault, ())) for memory, view, bits, fault
            in zip(batch.memories(), views, seen, faults, strict=True)]
        for n in at_once:
            found[n] = State(self.machine.reduced(starts[n][0]), views[n].state, 0, faults[n])
        for n in going:
            found[n] = None
        return found
