"""Wiring for `plcemu verify`: a configuration becomes a prover over a finite plant."""

from __future__ import annotations

from plant_sim.abstraction import Abstraction, AbstractionError, load_abstraction
from plcemu.base.errors import UnknownNameError
from plcemu.lang.compile import compile_program
from plcemu.monitor import Property, load_properties
from plcemu.runtime.config import Config
from plcemu.runtime.system import make_coupling, make_resource
from plcemu.verify.explore import Limits
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
    try:
        entries = [p for path in (*config.property_paths, *config.proof_paths)
                   for p in load_properties(path)]
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


def make_prover(config: Config, names: list[str] | None = None) -> Prover:
    """Return the prover of a configuration.

    Raises:
        CompileError: the program or a property is wrong.
        ConfigError: something that the configuration names does not exist or does not fit.
    """
    properties = load_demands(config, names)
    plant = make_abstraction(config)
    program = compile_program(config.program_paths, final_scan=config.sfc_final_scan,
                              single_firing=config.sipn_single_firing)
    wiring = make_coupling(config)
    return Prover(make_resource(config, program), plant, wiring.inputs, wiring.outputs,
                  config.cycle, properties, config.verify.merge)


def limits_of(config: Config) -> Limits:
    """Return where the proofs of a configuration give up."""
    section = config.verify.limits
    seconds = None if section.time is None else section.time / 1e9
    return Limits(section.states, seconds, section.memory_mb)
