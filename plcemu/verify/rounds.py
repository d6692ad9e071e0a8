"""Many steps of the closed loop at once: each round makes one scan of every step that goes on.

What a step is says `plcemu.verify.settle`; this comes to the same states with fewer crossings
between Python and the engine.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from plcemu.verify.settle import (
    SETTLES_WITHIN,
    DoesNotSettle,
    Settling,
    Start,
    State,
    reason_of,
)
from plcemu.verify.views import View


class Rounds(Settling):
    """Makes steps together."""

    def settled(self, starts: Iterable[Start], elapsed_ns: int) -> Iterator[State]:
        """Yield the states that steps lead to, in their order.

        Raises:
            DoesNotSettle: the next one leads to none.
        """
        for state in self._rounds(list(starts), elapsed_ns):
            if state is None:
                raise DoesNotSettle
            yield state

    def _rounds(self, starts: list[Start], elapsed_ns: int) -> list[State | None]:
        """Return the states; None for those that do not settle."""
        views, told, once, judge = self.views, self.told, self.once, self.judge
        run, follow, outputs = views.batch.run, views.follow, views.outputs
        found: list[State | None] = [None] * len(starts)
        seen = [0] * len(starts)
        memories = [memory for memory, _ in starts]
        going = [(n, views.of(plant)) for n, (_, plant) in enumerate(starts)]
        for scan in range(SETTLES_WITHIN):
            if not going:
                break
            ran = run(memories, [view.packed for _, view in going], elapsed_ns)
            self.machine.scans += len(going) - len(ran.faults)
            for at, fault in ran.faults.items():
                number, view = going[at]
                last = memories[at] if scan else self.machine.initial
                found[number] = State(last, view.state, seen[number] & told, reason_of(fault))
            on: list[tuple[int, View]] = []
            on_memories: list[bytes] = []
            for (number, view), before, memory, watched in zip(going, memories, ran.memories,
                                                               ran.watched, strict=True):
                if ran.faults and found[number] is not None:
                    continue
                holding = view.holding.get(watched)
                seen[number] |= judge(memory, view, watched) if holding is None else holding
                out = memory[outputs]
                following = view.follows.get(out) or follow(view, out)
                if once or (following is view and memory == before):
                    found[number] = State(memory, following.state, seen[number] & told)
                else:
                    on.append((number, following))
                    on_memories.append(memory)
            going, memories = on, on_memories
        return found
