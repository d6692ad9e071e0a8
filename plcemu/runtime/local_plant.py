"""A plant inside the process: the coupling worked on the exchange itself."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from itertools import compress
from operator import ne
from typing import NamedTuple

from hil.coupling import Checkpoint as CouplingCheckpoint
from hil.coupling import Coupling, picker
from plant_sim.contract import PortValue
from plcemu.base.tags import Tag
from plcemu.io.exchange import Exchange
from plcemu.io.mapping import Point

_LOG = logging.getLogger("plcemu.plant")

_TYPES = {"bool": "BOOL", "int": "LINT", "real": "LREAL"}


class Checkpoint(NamedTuple):
    """The state of a plant in the process, as the attributes of `LocalPlant`."""

    coupling: CouplingCheckpoint
    stepped_aside: bool
    written: tuple[int, ...]
    values: tuple[PortValue, ...]
    event_ns: int | None
    pending: tuple[tuple[str, int, bytes, bytes | None], ...]


class LocalPlant:
    """Couples a plant to the exchange, and shows its readings and facts as tags.

    A client that gives a wired input another value takes over: then an outside plant drives the
    inputs, and this one steps aside for good.

    Args:
        coupling: the plant and its wiring.
        exchange: of the PLC.
    """

    PORT = "plant"

    def __init__(self, coupling: Coupling, exchange: Exchange) -> None:
        self.coupling = coupling
        self.stepped_aside = False
        self._exchange = exchange
        self._port = exchange.port(self.PORT)
        self._written: list[int] = []
        self._only_self = {self.PORT}
        self._version = -1
        plant = coupling.plant
        wired = {p.name for p in coupling.inputs}
        sensors = [p for p in plant.ports if p.direction == "sensor" and p.name in wired]
        self.tags = [Tag(f"plant.{p.name}", _TYPES[p.kind], p.unit, comment=p.description)
                     for p in sensors]
        self.tags += [Tag(f"plant.{f.name}", _TYPES[f.kind], f.unit, comment=f.description)
                      for f in plant.facts]
        numbers = {p.name: n for n, p in enumerate(coupling.inputs)}
        self._inputs = [numbers[p.name] for p in sensors]
        """The number of the input that each sensor's reading goes to."""
        self._pick_sensors = picker([p.name for p in sensors])
        self._pick_facts = picker([f.name for f in plant.facts])
        self._values = self._read()
        self._event_ns = coupling.next_event_ns()

    def values(self) -> tuple[PortValue, ...]:
        """Return the values of the tags, in their order."""
        return self._values

    def advance(self, t_ns: int) -> None:
        """Bring the plant to an instant at which nothing is scanned."""
        if not self.stepped_aside:
            self.coupling.advance(t_ns, at_release=False)

    def before_scan(self, t_ns: int) -> None:
        """Bring the plant to the instant and queue the inputs that changed."""
        if self.stepped_aside:
            return
        self.coupling.advance(t_ns)
        event_ns = self._event_ns
        if event_ns is not None and t_ns >= event_ns:
            self._refresh()
        if not self._written:
            self._written = self.coupling.give_inputs()
            for n, raw in enumerate(self._written):
                self._port.write(*self.coupling.inputs[n].image_write(raw))

    def after_scan(self) -> None:
        """Let the plant follow the published outputs; note a take-over by a client."""
        if self.stepped_aside:
            return
        exchange = self._exchange
        if exchange.writers and exchange.writers != self._only_self and self._is_taken_over():
            return
        version = exchange.version
        if version != self._version:
            self._version = version
            if self.coupling.take_outputs(self._published(self.coupling.outputs)):
                self._refresh()

    def _is_taken_over(self) -> bool:
        others = self._exchange.writers - self._only_self
        if others and self._published(self.coupling.inputs) != self._written:
            self.stepped_aside = True
            self._event_ns = None
            _LOG.warning("%s writes the plant's inputs: the plant in this process steps aside",
                         ", ".join(sorted(others)))
        return self.stepped_aside

    def checkpoint(self) -> Checkpoint:
        """Return the whole state, the writes that wait for the next scan with it."""
        return Checkpoint(self.coupling.checkpoint(), self.stepped_aside, tuple(self._written),
                          self._values, self._event_ns, self._port.pending)

    def return_to(self, point: Checkpoint) -> None:
        """Take up the state of a checkpoint, after the exchange has returned to its own."""
        self.coupling.return_to(point.coupling)
        self.stepped_aside, self._event_ns = point.stepped_aside, point.event_ns
        self._written, self._values = list(point.written), point.values
        self._version = -1
        for write in point.pending:
            self._port.write(*write)

    def _published(self, points: Sequence[Point]) -> list[int]:
        return [p.from_image(self._exchange.published(*p.image_place())) for p in points]

    def next_event_ns(self) -> int | None:
        """Return the first instant at which a reading or fact has changed, if outputs stay."""
        return self._event_ns

    def _refresh(self) -> None:
        """Read the plant anew; queue the inputs whose raw values changed."""
        before, values = self._values, self._read()
        if values != before:
            self._values = values
            for sensor in compress(range(len(self._inputs)), map(ne, values, before)):
                self._give(self._inputs[sensor], values[sensor])
        self._event_ns = self.coupling.next_event_ns()

    def _give(self, n: int, reading: PortValue) -> None:
        raw = self.coupling.to_raw(n, reading)
        if self._written and raw != self._written[n]:
            self._written[n] = raw
            self._port.write(*self.coupling.inputs[n].image_write(raw))

    def _read(self) -> tuple[PortValue, ...]:
        """Return the present values of the tags."""
        return self._pick_sensors(self.coupling.sense()) + \
            self._pick_facts(self.coupling.plant.observe())
