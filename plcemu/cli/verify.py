"""`plcemu verify`: prove the properties for all runs, or show the counterexample."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.status import Status
from rich.table import Table

from plcemu.base.collector import paused_collector
from plcemu.base.errors import PlcemuError
from plcemu.base.time import format_duration
from plcemu.cli.output import add_config_arguments, console, print_json
from plcemu.cli.spin import print_opinion, write_promela
from plcemu.runtime.config import Config, load_config
from plcemu.runtime.counterexamples import save_counterexample
from plcemu.runtime.second_opinion import ask_spin
from plcemu.runtime.verification import fires_once, limits_of, make_prover
from plcemu.verify.explore import Progress
from plcemu.verify.prove import HOLDS, INCONCLUSIVE, VIOLATED, Proof, Prover, Result

HELP = "prove the properties for all runs of the compiled program, or show the counterexample"
EPILOG = """examples:
  plcemu verify il_programs/batch_plant                       # from the configured load
  plcemu verify il_programs/batch_plant --set initial=loads   # from all 30 loads of the paper
  plcemu verify il_programs/batch_plant --set load=7.5 --property produces --save .
  plcemu verify il_programs/evaporator                        # timers and a plant in time
  plcemu verify il_programs/evaporator --set verify.parameters.drain=torricelli
  plcemu verify il_programs/batch_plant --set verify.fairness=none    # processes need not end
  plcemu verify il_programs/batch_plant --set initial=loads --spin     # SPIN judges as well

Exit code 1 if a property is violated, a limit was reached before it was decided, one that was
asked for by name cannot be decided here, or SPIN judges otherwise."""

_SHOWN = 6
"""Initial states that are named before the rest is only counted."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    add_config_arguments(parser)
    parser.add_argument("--property", metavar="NAME", action="append", dest="names",
                        help="prove only this property; may be given several times")
    parser.add_argument("--save", metavar="FOLDER", type=Path,
                        help="write each counterexample as a scenario, NAME.yaml, for "
                        "simulate --no-plant --scenario, and its property, NAME.prop")
    parser.add_argument("--spin", action="store_true", help="let the model checker SPIN judge a "
                        "model of the closed loop as well, and compare (needs spin and gcc)")
    parser.add_argument("--promela", metavar="FILE", type=Path,
                        help="write the closed loop as a model for SPIN, and judge nothing")


@paused_collector()
def execute(arguments: argparse.Namespace) -> int:
    """Prove, and return 1 unless every property holds."""
    if arguments.save is not None and not arguments.save.is_dir():
        raise PlcemuError(f"--save {arguments.save}: there is no such folder")
    config = load_config(arguments.config, arguments.overrides)
    prover = make_prover(config, arguments.names,
                         recorded=bool(arguments.spin or arguments.promela))
    result = _with_progress(lambda told: prover.prove(limits_of(config), told))
    if arguments.promela is not None:
        for line in write_promela(arguments.promela, prover, result, config.name):
            console().print(line)
        return 0
    opinion = ask_spin(prover, result, config.name, limits_of(config)) if arguments.spin else None
    saved = _save(arguments, config, result, prover) if arguments.save else []
    if arguments.json:
        document = document_of(config.name, result)
        print_json(document if opinion is None else {**document, "spin": opinion.as_json()})
    else:
        _print(config.title, result)
        for line in saved:
            console().print(line)
        if opinion is not None:
            print_opinion(opinion)
    fails = any(_fails(p, arguments.names) for p in result.proofs)
    return 1 if fails or (opinion is not None and (opinion.differs or opinion.undecided)) else 0


def _fails(proof: Proof, names: list[str] | None) -> bool:
    """Whether a proof fails the command: also one that could not be decided, if it was asked for
    by name or only a limit stood in the way."""
    verdict = proof.finding.verdict
    if verdict == INCONCLUSIVE:
        return bool(names) or not proof.finding.out_of_scope
    return verdict == VIOLATED


def _save(arguments: argparse.Namespace, config: Config, result: Result,
          prover: Prover) -> list[str]:
    """Write the counterexamples as scenarios; return how each is played."""
    given = "".join(f" --set {shlex.quote(override)}" for override in arguments.overrides)
    if fires_once(config):
        given += " --set sipn_single_firing=true"
    told = []
    for proof in result.proofs:
        saved = save_counterexample(arguments.save, proof, prover)
        if saved is None:
            continue
        judged = f" --set properties={shlex.quote(str(saved.properties))}" \
            if saved.properties else ""
        told.append(f"written: {saved.scenario}; plays with: plcemu simulate "
                    f"{shlex.quote(arguments.config or '.')}{given}{judged} --no-plant --scenario "
                    f"{shlex.quote(str(saved.scenario))} --until {format_duration(saved.until_ns)}")
    return told


def _with_progress(work: Callable[[Callable[[Progress], None] | None], Result]) -> Result:
    """Run with a line that tells how far it is, on a terminal."""
    if not sys.stderr.isatty():
        return work(None)
    with Status("verifying", console=console(to_stderr=True)) as status:
        return work(lambda progress: status.update(f"verifying: {progress}"))


def document_of(name: str, result: Result) -> dict[str, Any]:
    """Return a result as the JSON document of `verify --json`."""
    graph = result.graph
    return {"name": name, "states": len(graph), "transitions": graph.edges, "scans": result.scans,
            "complete": graph.complete, "seconds": round(graph.seconds, 3), "cuts": result.cuts,
            "properties": [p.as_json() for p in result.proofs]}


def _print(name: str, result: Result) -> None:
    out, graph = console(), result.graph
    rate = result.scans / graph.seconds if graph.seconds else 0
    whole = "all" if graph.complete else "not all"
    out.print(f"{name}: {len(graph):,} states ({whole} that can be reached), {graph.edges:,} "
              f"transitions, {result.scans:,} scans in {graph.seconds:.2f} s ({rate:,.0f}/s)")
    for cut in result.cuts:
        out.print(f"  {cut}")
    table = Table(box=None, pad_edge=False)
    for heading in ("property", "verdict", "meaning"):
        table.add_column(heading, no_wrap=heading != "meaning", overflow="fold")
    for proof in result.proofs:
        verdict = proof.finding.verdict
        style = "" if verdict == HOLDS else "bold red" if verdict == VIOLATED else "yellow"
        vacuous = " (vacuous)" if proof.finding.vacuous_in else ""
        table.add_row(proof.name, verdict + vacuous, proof.description or proof.formula,
                      style=style)
    out.print(table)
    for proof in result.proofs:
        _print_details(proof)


def _print_details(proof: Proof) -> None:
    out, finding = console(), proof.finding
    if finding.verdict not in (HOLDS, VIOLATED):
        out.print(f"{proof.name} is inconclusive: {finding.reason}")
    if finding.vacuous_in:
        out.print(f"{proof.name} holds vacuously: {'; '.join(finding.vacuous_in)}")
    if finding.verdict == VIOLATED:
        out.print(f"\n{proof.name} is violated: {proof.formula}", style="bold red")
    if proof.initial:
        refuted = [name for name, verdict in proof.initial.items() if verdict == VIOLATED]
        more = f" and {len(refuted) - _SHOWN} more" if len(refuted) > _SHOWN else ""
        told = f"violated from {len(refuted)}: {'; '.join(refuted[:_SHOWN])}{more}" \
            if refuted else "violated from none"
        out.print(f"{proof.name}: {len(proof.initial) - len(refuted)} of {len(proof.initial)} "
                  f"initial states hold, {told}")
    if proof.path is not None and finding.verdict == VIOLATED:
        for line in proof.path.lines():
            out.print(line)
        if finding.remark:
            out.print(f"  {finding.remark}")
