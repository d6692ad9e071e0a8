"""Wiring for `plcemu verify`: a configuration becomes a prover over a finite plant."""

from __future__ import annotations

from collections.abc import Sequence

from plant_sim.abstraction import Abstraction, AbstractionError, load_abstraction
from plant_sim.contract import PortValue
from plant_sim.free_inputs import FreeInputs
from plcemu.base.errors import CompileError, UnknownNameError
from plcemu.io.mapping import Point
from plcemu.ir.program import Program
from plcemu.lang.compile import compile_program
from plcemu.monitor import Property, load_properties, parse_properties
from plcemu.monitor.formula import Formula
from plcemu.runtime.config import Config
from plcemu.runtime.system import make_coupling, make_resource
from plcemu.verify.check import is_plain
from plcemu.verify.explore import Limits
from plcemu.verify.machine import place_of
from plcemu.verify.promela_plant import RecordedPlant
from plcemu.verify.prove import Prover

FREE_INPUTS = "free_inputs"
"""The abstraction of which nothing is known but what the inputs are."""


def free_inputs(config: Config, inputs: Sequence[Point], program: Program) -> FreeInputs:
    """Return the plant that may give the inputs any value.

    Inputs of one bit take both values, or those that `verify.parameters` names for them; others
    must have some named, unless the program does not read them. Those stay at FALSE or 0.

    Raises:
        ConfigError: values of an input are missing or do not fit.
    """
    given = config.verify.parameters
    values: dict[str, Sequence[PortValue]] = {}
    for name in set(given) - {p.name for p in inputs}:
        raise config.mistake(("verify", "parameters", name), "is no input of the plant; there are "
                             + ", ".join(p.name for p in inputs))
    for point in inputs:
        off: PortValue = point.to_value(0)
        both: list[PortValue] | None = [False, True] if isinstance(off, bool) else None
        if not _uses(program, point):
            both = [off]
        named = given.get(point.name, both)
        if named is None:
            raise config.mistake(("verify", "parameters", point.name), "is missing: which values "
                                 f"may {point.name} ({point.address}) read? Give a list")
        values[point.name] = named if isinstance(named, list) else [named]
    try:
        return FreeInputs(values)
    except ValueError as problem:
        raise config.mistake(("verify", "parameters"), problem) from None


def _uses(program: Program, point: Point) -> bool:
    """Whether a program has a variable, declared or not, at a point's address."""
    place = place_of(program, point)
    return any(slot.offset == place for slot in program.layout.slots)


def make_abstraction(config: Config) -> Abstraction:
    """Return the finite plant of a configuration.

    Raises:
        ConfigError: there is none, or it does not take its parameters.
    """
    section = config.verify
    name = section.abstraction or (config.plant.model if config.plant else None)
    if name is None:
        raise config.mistake(("verify", "abstraction"), "is missing, and there is no plant whose "
                             "abstraction could be taken")
    parameters = {**(config.plant.parameters if config.plant else {}), **section.parameters}
    if section.initial is not None:
        parameters["initial"] = section.initial
    try:
        return load_abstraction(name, parameters)
    except AbstractionError as problem:
        raise config.mistake(("verify",), problem) from None


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


def make_prover(config: Config, names: list[str] | None = None, recorded: bool = False) -> Prover:
    """Return the prover of a configuration.

    Args:
        config: the configuration.
        names: of the properties to be proved; all if there are none.
        recorded: whether the plant writes down what it is asked, for an export to SPIN.

    Raises:
        CompileError: the program or a property is wrong.
        ConfigError: something that the configuration names does not exist or does not fit.
    """
    properties = load_demands(config, names)
    section = config.verify
    program = compile_program(config.program_paths, final_scan=config.sfc_final_scan,
                              single_firing=fires_once(config))
    wiring = make_coupling(config)
    inputs = wiring.inputs
    plant: Abstraction
    if section.abstraction == FREE_INPUTS:
        plant = free_inputs(config, inputs, program)
        inputs = tuple(p for p in inputs if _uses(program, p))
    else:
        plant = make_abstraction(config)
    if recorded:
        plant = RecordedPlant(plant)
    return Prover(make_resource(config, program), plant, inputs, wiring.outputs,
                  config.cycle, properties, section.merge, _frozen(config))


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
