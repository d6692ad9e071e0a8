"""Wiring for `plcemu schedule`: best schedules of a plant, beside the configured controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from plant_sim.abstraction import (
    AbstractionError,
    Case,
    Repair,
    Scheduling,
    load_abstraction,
    load_scheduling,
)
from plcemu.base.errors import ConfigError, PlcemuError
from plcemu.lang.compile import compile_program
from plcemu.runtime.config import Config
from plcemu.runtime.wiring import make_coupling, make_resource
from plcemu.verify.cone import cone_of
from plcemu.verify.loop import ClosedLoop
from plcemu.verify.machine import ScanMachine, place_of
from plcemu.verify.schedules.certificate import flaw_in
from plcemu.verify.schedules.controlled import run_controlled
from plcemu.verify.schedules.emit import orders, program_for
from plcemu.verify.schedules.schedule import (
    Certificate,
    Taken,
    TimedGraph,
    earliest,
    least_period,
    turned,
    way_into,
)


@dataclass(frozen=True, slots=True)
class Start:
    """A process in a schedule, in units of time."""

    process: str
    begin: int
    end: int


@dataclass(slots=True)
class Best:
    """The best schedule of one case.

    Attributes:
        case: the initial state.
        unit_s: the unit of time, in s.
        states: how many the timed system has.
        certificate: the proof of the least period; None if nothing can be produced for ever.
        flaw: what is wrong with the proof, by the independent check; empty if nothing is.
        controller: units of time per batch that the configured program takes; None if it does not
            produce for ever, or was not asked.
        repair: the smallest change of its priorities, where it is not optimal.
        way: the schedule of the earliest last batch; None if so many cannot be made.
        once: the process starts before the best cycle.
        again: those of the cycle.
        reason: why nothing can be produced.
    """

    case: Case
    unit_s: Fraction
    states: int
    certificate: Certificate[Any] | None
    flaw: str
    controller: Fraction | None
    repair: Repair | None
    way: list[Taken[Any]] | None
    once: list[str]
    again: list[str]
    reason: str

    def seconds(self, units: Fraction | int | None) -> float | None:
        """Return a number of units in s."""
        return None if units is None else float(units * self.unit_s)

    @property
    def period_s(self) -> float | None:
        """The least long-run time per batch, in s."""
        return self.seconds(self.certificate.period if self.certificate else None)

    def batch_starts_s(self, counted: str) -> list[float]:
        """When the batches of `way` start, in s."""
        return [float(taken.t * self.unit_s) for taken in self.way or ()
                for name in taken.move.starts if name == counted]

    def as_json(self, counted: str) -> dict[str, Any]:
        """Return it as plain values; the keys are those of `schedule --json`."""
        proved = self.certificate is not None
        exact = self.certificate.period * self.unit_s if self.certificate else None
        document: dict[str, Any] = {
            **self.case.keys, "possible": proved, "reason": self.reason,
            "period_s": self.period_s, "period_exact": None if exact is None else str(exact),
            "proved_optimal": proved and not self.flaw, "certificate_checked": proved
            and not self.flaw, "states": self.states, "starts_s": self.batch_starts_s(counted),
            "controller_period_s": self.seconds(self.controller)}
        if self.repair is not None:
            document["repair"] = {"first_then_second": [list(c) for c in self.repair.changes],
                                  "period_s": self.seconds(self.repair.period),
                                  "behaviours_tried": self.repair.tried}
        return document


class Scheduler:
    """Finds and proves best schedules for the plant of a configuration.

    Raises:
        ConfigError: there is no plant, or none that can be scheduled.
    """

    def __init__(self, config: Config) -> None:
        if config.plant is None:
            raise config.mistake(("plant",), "is missing; a schedule is of a plant's processes")
        self.config, self._plant = config, config.plant
        try:
            self.scheduling: Scheduling = load_scheduling(config.plant.model,
                                                          config.plant.parameters)
        except AbstractionError as problem:
            raise config.mistake(("plant", "model"), problem) from None
        self._loop: ClosedLoop | None = None

    def cases(self, which: str) -> Sequence[Case]:
        """Return the initial states; raises `ConfigError` if there are none by that name."""
        try:
            return self.scheduling.cases(which)
        except AbstractionError as problem:
            raise ConfigError([f"--load {which}: {problem}"]) from None

    def best(self, case: Case, batches: int) -> Best:
        """Return the best schedule of a case, and how the configured program compares."""
        protocol = self.scheduling.protocol(case)
        graph = TimedGraph(protocol)
        certificate = least_period(graph)
        found = Best(case, protocol.unit_s, len(graph.states), certificate, "", None, None,
                     earliest(graph, batches, certificate), [], [], "")
        if certificate is None:
            found.reason = self.scheduling.why_none(case)
            return found
        found.flaw = flaw_in(certificate, self.scheduling.protocol(case))
        way = way_into(graph, certificate)
        cycle = turned(certificate.cycle, way[-1].move.after if way else graph.states[0])
        found.once = [name for taken in way for name in taken.move.starts]
        found.again = [name for taken in cycle for name in taken.move.starts]
        found.controller = run_controlled(
            self._closed_loop(), case.plant, self.scheduling.durations(case),
            self.scheduling.counted).period
        if found.controller is not None and found.controller != certificate.period:
            found.repair = self.scheduling.repair(case, found.controller)
        return found

    def timetable(self, best: Best) -> list[Start]:
        """Return the processes of the schedule of the earliest last batch, with their ends."""
        units = self.scheduling.durations(best.case)
        return [Start(name, taken.t, taken.t + units[name]) for taken in best.way or ()
                for name in taken.move.starts]

    def program(self, best: Best) -> str:
        """Return an IEC program that follows the best schedule.

        Raises:
            PlcemuError: nothing can be produced, or the program has not the parts needed.
        """
        if best.certificate is None:
            raise PlcemuError(f"{best.case.name}: there is no schedule: {best.reason}")
        if len(self.config.program_paths) != 1:
            raise PlcemuError("a schedule can be written into a program of one file only")
        text = self.config.program_paths[0].read_text(encoding="utf-8")
        users = self.scheduling.users()
        title = (f"The best schedule from {best.case.name}: {best.period_s:g} s per batch in the "
                 f"long run,\n   proved optimal. Written by plcemu schedule from "
                 f"{Path(self.config.program[0]).name}; the rest is as there.")
        return program_for(text, orders(best.once, best.again, users), users, title)

    def _closed_loop(self) -> ClosedLoop:
        if self._loop is None:
            config = self.config
            program = compile_program(config.program_paths, final_scan=config.sfc_final_scan)
            wiring = make_coupling(config)
            places = [(p, place_of(program, p)) for p in wiring.outputs]
            asked = {at + n for p, at in places if at is not None for n in range(p.width)}
            machine = ScanMachine(make_resource(config, program), wiring.inputs,
                                  cone_of(program, asked))
            plant = load_abstraction(self._plant.model, self._plant.parameters)
            self._loop = ClosedLoop(machine, plant, wiring.inputs, wiring.outputs)
        return self._loop
