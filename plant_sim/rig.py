"""A plant with imperfect devices and with faults that come at set instants; itself a plant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from plant_sim.contract import Fact, FactValue, Plant, Port, PortValue
from plant_sim.devices import (
    Active,
    Device,
    Drive,
    Transmitter,
    check_devices,
    fault_image,
    faults_from,
    port_of,
)
from plant_sim.faults import Injection, check
from plant_sim.lines import NEVER_NS, exact
from plant_sim.parameters import Parameters

FAULTS_FACT = Fact("faults", "int", "", "faults that are present")

_IDEAL = Device()


class Rig:
    """A plant as the PLC meets it: through devices, and with faults.

    Args:
        plant: the plant itself, at its beginning.
        devices: of the ports that are not ideal.
        injections: the faults to come, in plant time.
        seed: of the noise.

    Raises:
        ValueError: a port cannot have its device (`FaultError`: or a target its fault).
    """

    def __init__(self, plant: Plant, devices: Mapping[str, Device] | None = None,
                 injections: Sequence[Injection] = (), seed: int = 0) -> None:
        self.plant = plant
        inner = {port.name: port for port in plant.ports}
        devices = dict(devices or {})
        check_devices(devices, inner)
        self.injections = tuple(check(one, inner) for one in injections)
        self.name = plant.name
        self.ports = tuple(port_of(p, devices.get(p.name, _IDEAL)) for p in plant.ports)
        self.facts = (*plant.facts, FAULTS_FACT)
        targets = {*devices, *(one.target for one in self.injections)}
        self._inner = inner
        self._sensors = {p.name: Transmitter(p, inner[p.name], devices.get(p.name, _IDEAL), seed)
                         for p in self.ports if p.direction == "sensor" and p.name in targets}
        self._drives = {
            p.name: Drive(p, devices.get(p.name, _IDEAL), self._off(p), self._off(p))
            for p in self.ports if p.direction == "actuator" and p.name in targets}
        changes = [(one.t_ns, n, True) for n, one in enumerate(self.injections)]
        changes += [(one.until_ns, n, False) for n, one in enumerate(self.injections)
                    if one.until_ns is not None]
        self._changes = sorted(changes)
        self._present: list[int] = []
        self._done = 0
        self._own_ns = -1
        self._run(plant.t_ns)

    @staticmethod
    def _off(port: Port) -> PortValue:
        return False if port.kind == "bool" else port.low

    # The contract

    @property
    def parameters(self) -> Parameters:
        """The checked parameters of the plant."""
        return self.plant.parameters

    @property
    def t_ns(self) -> int:
        """Plant time in ns since `reset`."""
        return self.plant.t_ns

    def reset(self) -> None:
        """Back to the initial state at `t_ns == 0`, all actuators off, no faults yet."""
        self.plant.reset()
        self._done = 0
        self._present = []
        for sensor in self._sensors.values():
            sensor.faults, sensor.history = [], []
        for drive in self._drives.values():
            drive.faults, drive.place, drive.t_ns = [], 0, 0
            drive.command = drive.output = self._off(drive.port)
        self._run(self.plant.t_ns)

    def actuate(self, values: Mapping[str, PortValue]) -> None:
        """Set the named actuators together; raises ValueError for a name that is none."""
        if not self._drives:
            self.plant.actuate(values)
        else:
            t_ns, passed = self.t_ns, dict(values)
            for name in self._drives.keys() & values.keys():
                drive = self._drives[name]
                drive.move(t_ns)
                value = values[name]
                drive.command = bool(value) if drive.port.kind == "bool" else float(value)
                drive.move(t_ns)
                passed[name] = drive.output
            self.plant.actuate(passed)
        self._settled()

    def disturb(self, values: Mapping[str, PortValue]) -> None:
        """Set the named disturbances together; raises ValueError for a name that is none."""
        self.plant.disturb(values)
        self._settled()

    def advance(self, t_ns: int) -> None:
        """Move to exactly `t_ns`. Raises ValueError if that is in the past."""
        if t_ns >= self._own_ns:
            self._run(t_ns)
        self.plant.advance(t_ns)

    def next_event_ns(self) -> int | None:
        """Earliest instant after now at which a watched reading or a fact may change."""
        event_ns = self.plant.next_event_ns()
        nexts = [self._own_ns] if event_ns is None else [self._own_ns, event_ns]
        if self._sensors:
            counts, t_ns = self.plant.counts(), self.t_ns
            nexts += [s.next_change_ns(t_ns, counts[n]) for n, s in self._sensors.items()
                      if n in counts]
        first = min(nexts)
        return first if first < NEVER_NS else None

    def sense(self) -> dict[str, PortValue]:
        """Present readings of the watched sensors, in their units."""
        values = self.plant.sense()
        counts = self.plant.counts() if self._sensors else {}
        for name in self._sensors.keys() & counts.keys():
            sensor = self._sensors[name]
            count = sensor.count(self.t_ns, counts[name])
            step = exact(sensor.port.resolution)
            values[name] = bool(count) if sensor.port.kind == "bool" \
                else count * step.numerator / step.denominator
        return values

    def counts(self) -> dict[str, int]:
        """The same readings as whole numbers of resolutions."""
        counts = self.plant.counts()
        for name in self._sensors.keys() & counts.keys():
            counts[name] = self._sensors[name].count(self.t_ns, counts[name])
        return counts

    def observe(self) -> dict[str, FactValue]:
        """Present values of all facts."""
        return {**self.plant.observe(), FAULTS_FACT.name: len(self._present)}

    def watch(self, names: Iterable[str] | None = None) -> None:
        """Let only these sensors cause events and appear in `sense` and `counts`; None: all."""
        self.plant.watch(names)
        self._settled()

    def report(self) -> dict[str, Any]:
        """The plant's summary, and the faults that are present."""
        present = [f"{one.target} {one.fault}" for n, one in enumerate(self.injections)
                   if n in self._present]
        report = self.plant.report()
        if "facts" in report:
            report["facts"] = {**report["facts"], FAULTS_FACT.name: len(self._present)}
        return {**report, "faults": present}

    def snapshot(self) -> dict[str, Any]:
        """The complete state, ready for JSON."""
        return {
            "plant": self.plant.snapshot(),
            "injections": [list(one) for one in self.injections],
            "done": self._done,
            "present": list(self._present),
            "sensors": {n: {"faults": fault_image(s.faults), "history": [*map(list, s.history)]}
                        for n, s in self._sensors.items()},
            "drives": {n: {"faults": fault_image(d.faults), "place": d.place, "t_ns": d.t_ns,
                           "command": d.command, "output": d.output}
                       for n, d in self._drives.items()},
        }

    def restore(self, image: Mapping[str, Any]) -> None:
        """Continue from a snapshot; raises ValueError for one of another plant or scenario."""
        if image.get("injections") != [list(one) for one in self.injections]:
            raise ValueError("the snapshot is not of this plant with these faults")
        self.plant.restore(image["plant"])
        self._done, self._present = image["done"], list(image["present"])
        for name, sensor in self._sensors.items():
            kept = image["sensors"][name]
            sensor.faults = faults_from(kept["faults"])
            sensor.history = [(t_ns, count) for t_ns, count in kept["history"]]
        for name, drive in self._drives.items():
            kept = image["drives"][name]
            drive.faults = faults_from(kept["faults"])
            drive.place, drive.t_ns = kept["place"], kept["t_ns"]
            drive.command, drive.output = kept["command"], kept["output"]
        self._own_ns = self._next_own_ns()

    # What happens by itself

    def _run(self, t_ns: int) -> None:
        """Let faults come and go, drives move and delayed readings be noted, up to an instant."""
        self._own_ns = self._next_own_ns()
        while self._own_ns <= t_ns:
            now_ns = max(self._own_ns, self.plant.t_ns)
            self.plant.advance(now_ns)
            while self._done < len(self._changes) and self._changes[self._done][0] <= now_ns:
                _, n, begins = self._changes[self._done]
                self._done += 1
                self._change(self.injections[n], n, begins)
            self._move_drives()
            self._settled()

    def _change(self, one: Injection, n: int, begins: bool) -> None:
        (self._present.append if begins else self._present.remove)(n)
        port = self._inner.get(one.target)
        if port is None or f"{one.target}.{one.fault}" in self._inner:
            disturbed = self._inner[f"{one.target}.{one.fault}"]
            value = one.value if begins and one.value is not None else self._off(disturbed)
            self.plant.disturb({disturbed.name: value})
            return
        sensor, drive = self._sensors.get(one.target), self._drives.get(one.target)
        device = sensor or drive
        assert device is not None
        travel_ns = drive.travel_ns if drive is not None else 0
        if drive is not None:
            drive.move(self.t_ns)
        if sensor is not None and not sensor.delay_ns:
            sensor.history.clear()
        if begins:
            held = self._reading(sensor) if sensor is not None else 0
            device.faults.append(Active(one.fault, one.value, one.t_ns, held))
        else:
            device.faults[:] = [a for a in device.faults if (a.fault, a.since_ns, a.value) !=
                                (one.fault, one.t_ns, one.value)]
        if drive is not None:
            drive.rescale(travel_ns)

    def _reading(self, sensor: Transmitter) -> int:
        """The present count of a sensor, watched or not."""
        counts = self.plant.counts()
        if sensor.port.name not in counts:
            return 0
        return sensor.count(self.t_ns, counts[sensor.port.name])

    def _move_drives(self) -> None:
        for drive in self._drives.values():
            drive.move(self.t_ns)
        self.plant.actuate({name: drive.output for name, drive in self._drives.items()})

    def _settled(self) -> None:
        """After every change: note what delayed sensors will show, find the next own instant."""
        counts: dict[str, int] | None = None
        for name, sensor in self._sensors.items():
            if sensor.delay_ns:
                counts = self.plant.counts() if counts is None else counts
                if name in counts:
                    sensor.record(self.t_ns, counts[name])
        self._own_ns = self._next_own_ns()

    def _next_own_ns(self) -> int:
        nexts = [drive.next_ns() for drive in self._drives.values()]
        if self._done < len(self._changes):
            nexts.append(self._changes[self._done][0])
        if any(sensor.delay_ns for sensor in self._sensors.values()):
            nexts.append(self.plant.next_event_ns() or NEVER_NS)
        return min(nexts, default=NEVER_NS)
