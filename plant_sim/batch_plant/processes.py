"""The twelve processes of the batch plant as a table: what each does to the contents of its tanks.

Source: Brinksma, Mader and Fehnker, "Verification and Optimization of a PLC Control Schedule",
Figures 4 (actuators) and 6 (contents that each process needs) and section 2.1 (what it leaves).
Two processes conflict (Figure 7) exactly if they share a tank; so the table says that, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from plant_sim.batch_plant.layout import COOLERS, TRANSFERS, Transfer
from plant_sim.batch_plant.parameters import BatchParameters

Change = Mapping[str, str]
"""Content before a process -> content after it; a content that is no key does not allow it."""

_SOLUTION_OUT = {"sol42C": "empty", "sol84C": "sol42C"}
_SOLUTION_IN = {"empty": "sol42C", "sol42C": "sol84C"}
_WATER_OUT = {"water28C": "empty", "water56C": "water28C"}
_WATER_IN = {"empty": "water28C", "water28C": "water56C"}

_CHANGES: dict[str, dict[str, Change]] = {
    "P1": {"B1": _SOLUTION_OUT, "B3": {"empty": "sol42C"}},
    "P2": {"B2": _WATER_OUT, "B3": {"empty": "water28C"}},
    "P3": {"B1": _SOLUTION_OUT, "B3": {"water28C": "sol70C"}},
    "P4": {"B2": _WATER_OUT, "B3": {"sol42C": "sol70C"}},
    "P5": {"B3": {"sol70C": "empty"}, "B4": {"empty": "sol70C", "sol70C": "sol140C"}},
    "P6": {"B4": {"sol70C": "empty", "sol140C": "sol70C"}, "B5": {"empty": "sol70C"}},
    "P7": {"B5": {"sol70C": "sol42H"},
           "B6": {"empty": "water28H", "water28C": "water56H", "water28H": "water56H"}},
    "P8": {"B5": {"sol42H": "empty"},
           "B7": {"empty": "sol42H", "sol42C": "sol84H", "sol42H": "sol84H"}},
    "P9": {"B7": {"sol42H": "sol42C", "sol84H": "sol84C"}},
    "P10": {"B6": {"water28H": "water28C", "water56H": "water56C"}},
    "P11": {"B7": _SOLUTION_OUT, "B1": _SOLUTION_IN},
    "P12": {"B6": _WATER_OUT, "B2": _WATER_IN},
}


@dataclass(frozen=True, slots=True)
class Process:
    """One process.

    Attributes:
        name: as in the paper, P1 to P12.
        actuators: what is on while it runs, and off when it does not.
        duration: the parameter with its duration in s.
        changes: what it does to the contents of each of its tanks.
    """

    name: str
    actuators: frozenset[str]
    duration: str
    changes: Mapping[str, Change]

    def duration_s(self, parameters: BatchParameters) -> Fraction:
        """How long it takes, exactly as the parameter is written."""
        return Fraction(str(getattr(parameters, self.duration)))


def _of_transfer(transfer: Transfer) -> list[Process]:
    names = [(transfer.process, frozenset(transfer.actuators))]
    if transfer.process_second:
        names.append((transfer.process_second, frozenset((*transfer.actuators, "Mixer"))))
    return [Process(name, on, transfer.duration, _CHANGES[name]) for name, on in names]


def _table() -> dict[str, Process]:
    rows = [process for transfer in TRANSFERS for process in _of_transfer(transfer)]
    rows += [Process(c.process, frozenset((c.valve,)), c.duration, _CHANGES[c.process])
             for c in COOLERS]
    rows.append(Process("P7", frozenset(("Heater",)), "heat_B5_s", _CHANGES["P7"]))
    return {row.name: row for row in sorted(rows, key=lambda row: int(row.name[1:]))}


PROCESSES: dict[str, Process] = _table()
"""Name -> process, in the paper's order."""


def conflicts() -> list[tuple[str, str]]:
    """The pairs of processes that must never run together: those that share a tank.

    P1 with P3 and P2 with P4 are left out as in Figure 7: their needs exclude each other.
    """
    rows = list(PROCESSES.values())
    return [(a.name, b.name) for n, a in enumerate(rows) for b in rows[n + 1:]
            if not a.changes.keys().isdisjoint(b.changes) and a.duration != b.duration]
