"""What came into a PLC while it ran, as a scenario that plays the run again without its plant."""

from __future__ import annotations

from collections.abc import Mapping

from plcemu.base.tags import TagTable
from plcemu.base.trace import Frame
from plcemu.base.types import Value
from plcemu.runtime.scenario import PLANT, STEPS_LIMIT, Scenario, dump_scenario


class InputLog:
    """An observer that keeps every change of an input, and what the scenario of the run set.

    A scan depends on memory and inputs alone, so a cold start with the same inputs at the same
    instants gives the same scans.

    Args:
        tags: of the run.
        scenario: that is played in it.
    """

    def __init__(self, tags: TagTable, scenario: Scenario) -> None:
        self._names = {i: tag.name for i, tag in enumerate(tags) if tag.address.startswith("%I")}
        self._steps: list[tuple[int, Mapping[str, Value]]] = []
        self._sets = [(step.t_ns, {name: value for name, value in step.sets
                                   if not name.casefold().startswith(PLANT)})
                      for step in scenario.steps]
        self.problem = "the scenario forces tags, which is not written down" \
            if any(step.forces for step in scenario.steps) else ""
        """Why the run cannot be played again from what is kept; empty if it can."""

    def observe(self, frame: Frame) -> None:
        """Take one frame."""
        names = self._names
        values = {names[i]: value for i, value in frame.changes if i in names and value is not None}
        if not values or self.problem:
            return
        if len(self._steps) >= STEPS_LIMIT - len(self._sets):
            self.problem = f"inputs changed in over {STEPS_LIMIT} scans"
            return
        self._steps.append((frame.t_ns, values))

    def scenario(self, end_ns: int, description: str) -> str:
        """Return what came up to and with an instant as the text of a scenario file."""
        steps = [step for step in (*self._sets, *self._steps) if step[1] and step[0] <= end_ns]
        return dump_scenario(sorted(steps, key=lambda step: step[0]), description)
