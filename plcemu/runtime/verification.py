"""Wiring for `plcemu verify`: a configuration becomes a prover over a finite plant."""

from __future__ import annotations

from collections.abc import Sequence

from plant_sim.abstraction import ABSTRACTIONS, Abstraction, AbstractionError, load_abstraction
from plant_sim.linear_automaton import AutomatonError
from plcemu.base.errors import CompileError, UnknownNameError
from plcemu.io.mapping import Point
from plcemu.ir.program import Program
from plcemu.lang.compile import compile_program
from plcemu.monitor import Property, load_properties, parse_properties
from plcemu.monitor.formula import Formula
from plcemu.runtime.config import Config
from plcemu.runtime.free_inputs import FREE_INPUTS, all_inputs, free_inputs, is_used
from plcemu.runtime.wiring import make_coupling, make_resource
from plcemu.verify.check import is_plain
from plcemu.verify.explore import Limits
from plcemu.verify.promela.plant import RecordedPlant
from plcemu.verify.prove import Prover


def make_abstraction(config: Config) -> Abstraction:
    """Return the finite plant of a configuration.

    Raises:
        ConfigError: there is none, or it does not take its parameters.
    """
    section = config.verify
    name = section.abstraction or (config.plant.model if config.plant else None)
    if name is None:
        raise config.mistake(("verify", "abstraction"), "is missing, and there is no plant whose "
                             f"abstraction could be taken; {FREE_INPUTS} lets every input of the "
                             "program change at any time")
    parameters = {**(config.plant.parameters if config.plant else {}), **section.parameters}
    if section.initial is not None:
        parameters["initial"] = section.initial
    try:
        return load_abstraction(name, parameters)
    except (AbstractionError, AutomatonError) as problem:
        hint = "" if name in ABSTRACTIONS or ":" in name else (
            f", or {FREE_INPUTS}: every input may change at any time")
        raise config.mistake(("verify",), f"{problem}{hint}") from None


def load_demands(config: Config, names: list[str] | None = None) -> list[Property]:
    """Return the properties to be proved: all, or those of these names.

    Raises:
        CompileError: a property file is wrong.
        ConfigError: a file cannot be read.
        UnknownNameError: there is no property of a name.
    """
    monitored = config.property_paths if config.verify.monitored else []
    try:
        entries = [p for path in (*monitored, *config.proof_paths) for p in load_properties(path)]
    except OSError as problem:
        raise config.mistake(("verify", "properties"),
                             f"{problem.filename}: {problem.strerror}") from None
    if not names:
        return entries
    known = {p.name.casefold(): p for p in entries}
    for name in names:
        if name.casefold() not in known:
            raise UnknownNameError("property", name, [p.name for p in entries])
    return [known[name.casefold()] for name in names]


def make_prover(config: Config, names: list[str] | None = None, together: bool = True,
                recorded: bool = False) -> Prover:
    """Return the prover of a configuration.

    Args:
        config: the configuration.
        names: of the properties to be proved; all if None.
        together: see `Prover`.
        recorded: whether the plant writes down what it is asked, for an export to SPIN.

    Raises:
        CompileError: the program or a property is wrong.
        ConfigError: something that the configuration names does not exist or does not fit.
    """
    properties = load_demands(config, names)
    section = config.verify
    program = compile_program(config.program_paths, final_scan=config.sfc_final_scan,
                              single_firing=fires_once(config))
    plant, inputs, outputs = _plant(config, program)
    if section.merge == "timed":
        inputs = [p for p in inputs if is_used(program, p)]
        if section.frozen is not None:
            raise config.mistake(("verify", "frozen"), "does not go with merge: timed, where the "
                                 "plant's invariants say when something must happen")
        if recorded:
            raise config.mistake(("verify", "merge"), "is timed, and SPIN keeps no time")
    if recorded:
        plant = RecordedPlant(plant)
    return Prover(make_resource(config, program), plant, inputs, outputs,
                  config.cycle, properties, section.merge, _frozen(config), section.fairness,
                  together, section.time)


def _plant(config: Config, program: Program
           ) -> tuple[Abstraction, Sequence[Point], Sequence[Point]]:
    """Return the finite plant, the inputs that it drives, and the outputs that it follows."""
    if config.verify.abstraction != FREE_INPUTS:
        plant, wiring = make_abstraction(config), make_coupling(config)
        return plant, wiring.inputs, wiring.outputs
    wired: tuple[Point, ...] = ()
    outputs: tuple[Point, ...] = ()
    if config.plant is not None:
        wiring = make_coupling(config)
        wired, outputs = wiring.inputs, wiring.outputs
    inputs = all_inputs(config, wired, program)
    return (free_inputs(config, inputs, program, wired),
            [p for p in inputs if is_used(program, p)], outputs)


def fires_once(config: Config) -> bool:
    """Whether nets fire once in a scan of the proofs: as they say themselves, or as everywhere."""
    own = config.verify.sipn_single_firing
    return config.sipn_single_firing if own is None else own


def _frozen(config: Config) -> Formula | None:
    """Return the state formula during which the plant does nothing; None if there is none."""
    text = config.verify.frozen
    if text is None:
        return None
    try:
        formula = parse_properties(f"frozen: {text}")[0].formula
    except CompileError as problem:
        raise config.mistake(("verify", "frozen"), problem) from None
    if not is_plain(formula):
        raise config.mistake(("verify", "frozen"), f"{text} does not speak of one instant only")
    return formula


def limits_of(config: Config) -> Limits:
    """Return where the proofs of a configuration give up."""
    section = config.verify.limits
    seconds = None if section.time is None else section.time / 1e9
    return Limits(section.states, seconds, section.memory_mb)
