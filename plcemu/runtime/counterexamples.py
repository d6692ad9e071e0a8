"""Counterexamples as files: a scenario that `simulate` plays, and its property to be judged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic
from plcemu.monitor import parse_formula
from plcemu.monitor.formula import tag_refs
from plcemu.monitor.linear import on_one_run
from plcemu.verify.check import VIOLATED
from plcemu.verify.prove import Proof, Prover

ROUNDS = 3
"""How often what a counterexample repeats for ever is played."""


@dataclass(frozen=True, slots=True)
class Saved:
    """What was written of a counterexample.

    Attributes:
        scenario: the file with the inputs of every scan, and what the property asks of the plant.
        properties: the file with the property alone; None if no monitor can judge it on one run.
        until_ns: how long the run is to be played.
    """

    scenario: Path
    properties: Path | None
    until_ns: int


def save_counterexample(folder: Path, proof: Proof, prover: Prover) -> Saved | None:
    """Write a counterexample as files named after its property; None if the proof has none.

    Raises:
        OSError: a file cannot be written.
    """
    path = proof.path
    if path is None or proof.finding.verdict != VIOLATED:
        return None
    judged = is_monitored(proof.formula)
    facts = _facts(proof.formula, prover) if judged else ()
    scenario = folder / f"{proof.name}.yaml"
    text = f"Counterexample to {proof.name}: {proof.formula}, from {path.start}"
    scenario.write_text(path.scenario(text, prover.loop.inputs, facts, ROUNDS), encoding="utf-8")
    properties = None
    if judged:
        properties = folder / f"{proof.name}.prop"
        properties.write_text(f"{proof.name}:\n  {proof.formula}\n", encoding="utf-8")
    last_ns = path.at_ns(len(path.played(ROUNDS)) - 1) + path.decided_ns
    return Saved(scenario, properties, last_ns + path.cycle_ns)


def is_monitored(text: str) -> bool:
    """Whether a monitor can judge a formula on the one run that it sees."""
    diagnostics: list[Diagnostic] = []
    try:
        on_one_run(parse_formula(text), diagnostics)
    except CompileError:
        return False
    return not diagnostics


def _facts(text: str, prover: Prover) -> set[str]:
    """Return the tags of the plant that a formula speaks of."""
    named = {ref.name.casefold() for ref in tag_refs(parse_formula(text))}
    return {tag.name for tag in prover.predicates.tags
            if tag.name.startswith("plant.") and tag.name.casefold() in named}
