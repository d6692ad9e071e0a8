"""What an observer of the batch plant notes: batches, process starts, spills, wrong mixtures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from plant_sim.batch_plant.flows import TankMode
from plant_sim.batch_plant.instruments import FACTS
from plant_sim.batch_plant.layout import (
    CONCENTRATION_G_L,
    COOLERS,
    HEATED,
    MIXED_L,
    MIXED_TOLERANCE_L,
    MIXER_TANK,
    PUMPS,
    TANKS,
    TOLERANCE_G_L,
    TRANSFERS,
    Liquid,
    Transfer,
)
from plant_sim.batch_plant.tanks import BatchTanks
from plant_sim.contract import FactValue
from plant_sim.hybrid import Timer
from plant_sim.memory import Memory

BATCH_TIMES_KEPT = 1000
"""Latest batch starts kept for the period in the report."""

_BOOLS = tuple(fact.name for fact in FACTS if fact.kind == "bool")
_FLOWS = [(transfer, f"{transfer.name} flows") for transfer in TRANSFERS]
_NOT_SINCE = -1
_BATCH_OPEN = "batch in B3 counted"


def begin(memory: Memory) -> None:
    """Everything noted before the start: nothing."""
    memory.flags.update((fact.name, False) for fact in FACTS if fact.kind == "bool")
    memory.flags.update((f"{transfer.name} flows", False) for transfer in TRANSFERS)
    for state in ("full", "low"):
        memory.flags.update((f"{tank.name} {state}", False) for tank in TANKS)
    memory.flags.update((process, False) for process in ("P7", "P9", "P10"))
    memory.flags[_BATCH_OPEN] = memory.flags["moves"] = False
    memory.numbers.update(batches=0, first_batch_ns=-1, last_batch_ns=-1, moved_ns=0)
    memory.numbers.update((f"{pump} {fault} since", _NOT_SINCE) for pump, fault in _pump_faults())
    memory.words["forbidden_mixture"] = ""
    memory.series["batch_ns"] = ()


def facts_of(memory: Memory) -> dict[str, FactValue]:
    """Present values of all facts, in the order of the table."""
    values: dict[str, FactValue] = {"batches": memory.numbers["batches"]}
    for when in ("first_batch", "last_batch"):
        t_ns = memory.numbers[f"{when}_ns"]
        values[f"{when}_s"] = t_ns / 1e9 if t_ns >= 0 else -1.0
    flags = memory.flags
    values.update(zip(_BOOLS, map(flags.__getitem__, _BOOLS), strict=True))
    return values


def supervise(plant: BatchTanks, modes: Mapping[str, TankMode]) -> None:
    """Note what begins or goes wrong as the plant enters these modes."""
    flags, numbers = plant.memory.flags, plant.memory.numbers
    running = {
        flow.name: flow.transfer
        for mode in modes.values()
        for flow in mode.inflows
        if flow.transfer is not None
    }
    _note_transfers(plant, running)
    _note_thermal(plant, modes)
    for tank, mode in modes.items():
        flags[f"{tank} full"] = mode.spilled > 0
        if mode.spilled:
            flags["overflow"] = flags[f"{tank}.overflow"] = True
    for transfer in running.values():
        _check_carried(plant, transfer)
    _check_mixer(plant, modes[MIXER_TANK])
    if plant.actuators["Heater"] and plant.volume(HEATED) == 0:
        flags["B5.dry_heating"] = True
    _watch_pumps(plant)
    moves = bool(running) or any(mode.thermal for mode in modes.values())
    if moves or flags["moves"]:
        numbers["moved_ns"] = plant.t_ns
    flags["moves"] = moves


def pump_timers(plant: BatchTanks) -> Iterator[Timer]:
    """When pumps that run dry or blocked will have done so for too long."""
    for pump, fault in _pump_faults():
        since_ns = plant.memory.numbers[f"{pump} {fault} since"]
        if since_ns != _NOT_SINCE and not plant.memory.flags[f"{pump}.{fault}"]:
            yield Timer(f"{pump} {fault}", since_ns + plant.pump_grace_ns)


def _pump_faults() -> Iterable[tuple[str, str]]:
    return [(pump, fault) for pump in PUMPS for fault in ("dry", "blocked")]


def _note_transfers(plant: BatchTanks, running: Mapping[str, Transfer]) -> None:
    flags = plant.memory.flags
    if plant.volume(MIXER_TANK) == 0 or any(t.sink == MIXER_TANK for t in running.values()):
        flags[_BATCH_OPEN] = False
    for transfer, flag in _FLOWS:
        flows = transfer.name in running
        if flows and not flags[flag]:
            second = transfer.process_second and plant.volume(transfer.sink) > 0
            plant.note(transfer.process_second if second else transfer.process)
            if transfer.source == MIXER_TANK:
                _count_batch(plant)
        flags[flag] = flows


def _count_batch(plant: BatchTanks) -> None:
    memory, volume = plant.memory, plant.volume(MIXER_TANK)
    off = abs(volume - plant.units.of_litres(MIXED_L))
    is_batch = off <= plant.units.of_litres(MIXED_TOLERANCE_L) and _is(plant, MIXER_TANK, "mixed")
    if memory.flags[_BATCH_OPEN] or not is_batch:
        return
    memory.flags[_BATCH_OPEN] = True
    memory.numbers["batches"] += 1
    if memory.numbers["batches"] == 1:
        memory.numbers["first_batch_ns"] = plant.t_ns
    memory.numbers["last_batch_ns"] = plant.t_ns
    kept = (*memory.series["batch_ns"], plant.t_ns)
    memory.series["batch_ns"] = kept[-BATCH_TIMES_KEPT:]


def _note_thermal(plant: BatchTanks, modes: Mapping[str, TankMode]) -> None:
    active = {
        cooler.process: bool(plant.actuators[cooler.valve]) and plant.volume(cooler.tank) > 0
        for cooler in COOLERS
    }
    active["P7"] = modes[HEATED].thermal in ("heating", "boiling")
    for process, runs in active.items():
        if runs and not plant.memory.flags[process]:
            plant.note(process)
        plant.memory.flags[process] = runs


def _is(plant: BatchTanks, tank: str, liquid: Liquid) -> bool:
    off_g_l = abs(plant.concentration_g_l(tank) - CONCENTRATION_G_L[liquid])
    return off_g_l <= TOLERANCE_G_L[liquid]


def _check_carried(plant: BatchTanks, transfer: Transfer) -> None:
    if not _is(plant, transfer.source, transfer.carries):
        found = float(plant.concentration_g_l(transfer.source))
        wanted = float(CONCENTRATION_G_L[transfer.carries])
        _forbid(plant, f"{transfer.name} carries {found:.2f} g/l instead of {wanted:g} g/l")


def _check_mixer(plant: BatchTanks, mode: TankMode) -> None:
    """A second component may come into B3 only while the stirrer runs."""
    transfers = [flow.transfer for flow in mode.inflows if flow.transfer is not None]
    if not transfers or plant.actuators["Mixer"]:
        return
    alone = len(transfers) == 1
    filled = plant.volume(MIXER_TANK) > 0
    if not alone or (filled and not _is(plant, MIXER_TANK, transfers[0].carries)):
        _forbid(plant, f"{transfers[0].name} adds a second component to B3 without the mixer")


def _forbid(plant: BatchTanks, what: str) -> None:
    if not plant.memory.flags["forbidden_mixture"]:
        plant.memory.flags["forbidden_mixture"] = True
        plant.memory.words["forbidden_mixture"] = f"{plant.t_ns / 1e9:g} s: {what}"


def _watch_pumps(plant: BatchTanks) -> None:
    memory, on, t_ns = plant.memory, plant.actuators, plant.t_ns
    for pump, transfer in PUMPS.items():
        runs = bool(on[pump])
        is_open = all(on[name] for name in transfer.actuators)
        dry = runs and plant.volume(transfer.source) == 0
        for fault, present in (("dry", dry), ("blocked", runs and not is_open)):
            key = f"{pump} {fault} since"
            if not present:
                memory.numbers[key] = _NOT_SINCE
            elif memory.numbers[key] == _NOT_SINCE:
                memory.numbers[key] = t_ns
            if present and t_ns >= memory.numbers[key] + plant.pump_grace_ns:
                memory.flags[f"{pump}.{fault}"] = True
