"""What a scheduler may ask of the batch plant: its loads, durations, tanks, and why one fails."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any

from plant_sim.abstraction import AbstractionError, Case, Repair
from plant_sim.batch_plant.abstraction import BatchAbstraction, load_name
from plant_sim.batch_plant.layout import SOLUTION_L, WATER_L
from plant_sim.batch_plant.loads import content_of, read_tanks, tanks_of_load
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.priorities import PAPER, Outcome, is_acyclic, outcomes
from plant_sim.batch_plant.processes import PROCESSES
from plant_sim.batch_plant.protocol import COUNTED, Protocol
from plant_sim.parameters import ParameterError

_HALVES = ("solution", "water")


class BatchScheduling:
    """The batch plant for a scheduler.

    Args:
        parameters: those of `BatchPlant`.

    Raises:
        AbstractionError: a parameter does not exist or cannot have its value.
    """

    counted = COUNTED

    def __init__(self, parameters: Mapping[str, object]) -> None:
        self._given = dict(parameters)
        self._parameters = self._read({})

    def _read(self, changed: Mapping[str, object]) -> BatchParameters:
        try:
            return BatchParameters.of({**self._given, **changed})
        except ParameterError as problem:
            raise AbstractionError(str(problem)) from None

    def cases(self, which: str) -> Sequence[Case]:
        """The configured contents, all loads, or one load; half loads of either kind, unless the
        parameters name one."""
        halves = (self._parameters.half,) if "half" in self._given else _HALVES
        if which == "configured":
            tanks = read_tanks(self._parameters.tanks)
            if tanks:
                return [self._case(", ".join(f"{t}={w}" for t, w in tanks.items()),
                                   {"tanks": dict(tanks)}, {})]
            return [self._load(self._parameters.load, self._parameters.half)]
        if which == "all":
            return [self._load(n / 2, half) for n in range(17)
                    for half in (halves if n % 2 else _HALVES[:1])]
        load = self._read({"load": which}).load
        return [self._load(load, half) for half in (halves if load % 1 else _HALVES[:1])]

    def _load(self, load: float, half: str) -> Case:
        keys: dict[str, Any] = {"load": int(load) if load == int(load) else load}
        if load != int(load):
            keys["half"] = half
        return self._case(load_name(load, half), keys, {"load": load, "half": half, "tanks": {}})

    def _case(self, name: str, keys: Mapping[str, Any], changed: Mapping[str, Any]) -> Case:
        parameters = {**self._given, **changed}
        plant = next(iter(BatchAbstraction(parameters).initial()))
        return Case(name, keys, parameters, plant)

    def protocol(self, case: Case, eager: bool = True) -> Protocol:
        """The timed system of a case."""
        return Protocol(self._read(case.parameters), self._tanks(case), eager)

    def durations(self, case: Case) -> dict[str, int]:
        """How long each process takes, in the protocol's units of time."""
        return dict(zip(PROCESSES, self.protocol(case).units, strict=True))

    def users(self) -> dict[str, tuple[str, ...]]:
        """For each process its tanks."""
        return {name: tuple(row.changes) for name, row in PROCESSES.items()}

    def why_none(self, case: Case) -> str:
        """What there is too little or too much of, and where every run ends."""
        contents = [content_of(word) for word in self._tanks(case).values()]
        salt_g = sum(c.volume_l * c.concentration_g_l for c in contents)
        solution = Fraction(salt_g) / (5 * SOLUTION_L)
        water = (sum(c.volume_l for c in contents) - solution * SOLUTION_L) / WATER_L
        amounts = f"{float(solution):g} units of solution and {float(water):g} of water"
        ends = "; ".join(self._standstills(case))
        if min(solution, water) < 1:
            return f"{amounts} do not make one batch; every run ends with {ends}"
        return f"{amounts} leave too little room to move; every run ends with {ends}"

    def _standstills(self, case: Case) -> Iterator[str]:
        protocol = self.protocol(case)
        seen = set(protocol.initial())
        todo = list(seen)
        while todo:
            state = todo.pop()
            moves = protocol.moves(state)
            if not moves:
                held = [f"{t}={w}" for t, w in protocol.tanks(state).items() if w != "empty"]
                yield " ".join(held) or "all tanks empty"
            new = {move.after for move in moves} - seen
            seen |= new
            todo.extend(new)

    def repair(self, case: Case, period: Fraction) -> Repair | None:
        """The fewest pairs of Figure 8 to turn round for the best period that priorities give."""
        protocol = self.protocol(case, eager=False)
        if [o.period for o in outcomes(protocol, PAPER)] != [period]:
            return None
        found = list(outcomes(protocol))
        able = [o for o in found if o.period is not None
                and is_acyclic({**PAPER, **o.decisions})]
        best = min(able, key=_merit)
        changes = tuple((best.decisions[pair], next(n for n in pair if n != best.decisions[pair]))
                        for pair in best.changes(PAPER))
        return Repair(changes, best.period or period, len(found))

    def _tanks(self, case: Case) -> Mapping[str, str]:
        parameters = self._read(case.parameters)
        return read_tanks(parameters.tanks) or tanks_of_load(parameters.load, parameters.half)


def _merit(outcome: Outcome) -> tuple[Fraction, int]:
    assert outcome.period is not None
    return outcome.period, len(outcome.changes(PAPER))
