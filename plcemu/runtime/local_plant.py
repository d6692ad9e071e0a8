"""A plant inside the process: the coupling worked on the exchange itself."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from itertools import compress
from operator import ne
from typing import NamedTuple

from hil.coupling import Checkpoint as CouplingCheckpoint
from hil.coupling import Coupling, picker
from plant_sim.contract import PortValue
from plcemu.base.tags import Tag
from plcemu.base.types import Value
from plcemu.io.exchange import Exchange
from plcemu.io.mapping import Point

_LOG = logging.getLogger("plcemu.plant")

_TYPES = {"bool": "BOOL", "int": "LINT", "real": "LREAL"}


class Checkpoint(NamedTuple):
    """The state of a plant in the process, as the attributes of `LocalPlant`."""

    coupling: CouplingCheckpoint
    stepped_aside: bool
    written: tuple[int | None, ...]
    values: tuple[Value, ...]
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
        self._written: Sequence[int | None] = [None] * len(coupling.inputs)
        self._version = -1
        plant = coupling.plant
        wired = {p.name for p in coupling.inputs}
        sensors = [p for p in plant.ports if p.direction == "sensor" and p.name in wired]
        self.tags = [Tag(f"plant.{p.name}", _TYPES[p.kind], p.unit, comment=p.description)
                     for p in sensors]
        self.tags += [Tag(f"plant.{f.name}", _TYPES[f.kind], f.unit, comment=f.description)
                      for f in plant.facts]
        self._pick_sensors = picker([p.name for p in sensors])
        self._pick_facts = picker([f.name for f in plant.facts])
        self._values: tuple[Value, ...] = ()
        self._read()
        self._event_ns = coupling.next_event_ns()

    def values(self) -> tuple[Value, ...]:
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
        if self._event_ns is not None and t_ns >= self._event_ns:
            self._refresh()
        elif self._written[:1] == [None]:
            self._write(self.coupling.sense())

    def after_scan(self) -> None:
        """Let the plant follow the published outputs; note a take-over by a client."""
        if self.stepped_aside:
            return
        if self._exchange.writers and self._is_taken_over():
            return
        version = self._exchange.version
        if version != self._version:
            self._version = version
            if self.coupling.take_outputs(self._published(self.coupling.outputs)):
                self._refresh()

    def _is_taken_over(self) -> bool:
        others = self._exchange.writers - {self.PORT}
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
        self._written, self._values = point.written, point.values
        self._version = -1
        for write in point.pending:
            self._port.write(*write)

    def _published(self, points: Sequence[Point]) -> list[int]:
        return [p.from_image(self._exchange.published(*p.image_place())) for p in points]

    def next_event_ns(self) -> int | None:
        """Return the first instant at which a reading or fact has changed, if outputs stay."""
        return self._event_ns

    def _refresh(self) -> None:
        self._write(self._read())
        self._event_ns = self.coupling.next_event_ns()

    def _write(self, sensed: Mapping[str, PortValue]) -> None:
        raw, written = self.coupling.give_inputs(sensed), self._written
        for n in compress(range(len(raw)), map(ne, raw, written)):
            self._port.write(*self.coupling.inputs[n].image_write(raw[n]))
        self._written = raw

    def _read(self) -> Mapping[str, PortValue]:
        """Bring the tags' values up to date; return the readings among them."""
        sensed, facts = self.coupling.sense(), self.coupling.plant.observe()
        values = self._pick_sensors(sensed) + self._pick_facts(facts)
        if values != self._values:
            self._values = values
        return sensed
