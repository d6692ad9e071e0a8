"""The compiled program as the controller of a hybrid automaton: its scan, and nothing modelled."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence

from plcemu.base.errors import PlcemuError
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.verify.cone import cone_of
from plcemu.verify.hybrid.reach import Values
from plcemu.verify.machine import ScanMachine, place_of


class ProgramController:
    """Scans of a program, for `plcemu.verify.hybrid.reach.reach`.

    What a program does in a scan depends on memory and inputs alone; each pair is scanned once.

    Args:
        resource: with the program, at its cold start.
        inputs: where the sensors' readings go; all Boolean.
        outputs: what the actuators follow; all Boolean.

    Raises:
        PlcemuError: a point is no bit; the program measures time, of which the length of a cycle is
            not known beforehand.
    """

    def __init__(self, resource: Resource, inputs: Sequence[Point],
                 outputs: Sequence[Point]) -> None:
        for point in (*inputs, *outputs):
            if not point.is_bit:
                raise PlcemuError(f"{point.name} at {point.address}: only bits can be exchanged "
                                  "with a hybrid automaton")
        self._places = [(p.name, place_of(resource.program, p)) for p in outputs]
        asked = {at for _, at in self._places if at is not None}
        kept = cone_of(resource.program, asked)
        clocks = [c for c in resource.program.layout.clocks
                  if c.observed and (kept is None or c.offset in kept)]
        if clocks:
            raise PlcemuError("the program reads timers or step times, and cycles have no fixed "
                              "length: what it does is not a matter of its inputs alone")
        self._names = [p.name for p in inputs]
        self._machine = ScanMachine(resource, inputs, kept)
        self._known: dict[tuple[Hashable, tuple[bool, ...]], tuple[bytes, Values]] = {}

    @property
    def scans(self) -> int:
        """Scans executed so far."""
        return self._machine.scans

    def start(self) -> bytes:
        """Return memory before the first scan."""
        return self._machine.reduced(self._machine.initial)

    def scan(self, state: Hashable, inputs: Mapping[str, bool]) -> tuple[bytes, Values]:
        """Return memory after a scan with these readings, and what the actuators are told."""
        read = tuple([inputs.get(name, False) for name in self._names])
        known = self._known.get((state, read))
        if known is None:
            assert isinstance(state, bytes)
            image = self._machine.image([bytes((bit,)) for bit in read])
            after = self._machine.reduced(self._machine.scan(state, image))
            outputs = tuple((name, at is not None and bool(after[at])) for name, at in self._places)
            known = self._known[state, read] = after, outputs
        return known
