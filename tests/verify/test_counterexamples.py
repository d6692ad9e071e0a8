"""Every counterexample plays in `simulate`, and the monitor violates there at the same instant."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from systems import BATCH, ROOT, batch_config, write_config

from plcemu.runtime.config import Config, load_config
from plcemu.runtime.counterexamples import ROUNDS, Saved, is_monitored, save_counterexample
from plcemu.runtime.scenario import load_scenario
from plcemu.runtime.system import System
from plcemu.runtime.verification import fires_once, make_prover
from plcemu.verify.prove import Proof, Prover

TANK = ROOT / "il_programs/heating_tank"

LAMP = """PROGRAM MAIN
VAR a AT %IX0.0 : BOOL; b AT %IX0.1 : BOOL; level AT %IW1 : INT; END_VAR
VAR lamp AT %QX0.0 : BOOL; twice AT %QX0.1 : BOOL; n : INT; idle : INT; END_VAR
lamp := a AND NOT b;
IF b THEN n := 0; ELSIF a AND n < 3 THEN n := n + 1; END_IF;
IF NOT a THEN idle := idle + 1; END_IF;
twice := n >= 2 AND level < 40;
END_PROGRAM
"""
DIVIDES = """PROGRAM MAIN
VAR level AT %IW1 : INT; rest AT %QW1 : INT; END_VAR
rest := 100 / (level - 7);
END_PROGRAM
"""
LATE = """PROGRAM MAIN
VAR a AT %IX0.0 : BOOL; lamp AT %QX0.0 : BOOL; delay : TON; END_VAR
delay(IN := a, PT := T#25ms);
lamp := delay.Q;
END_PROGRAM
"""
DEMANDS = {
    "never": "G !twice", "either": "G (lamp | !a)", "first": "lamp",
    "after_all": "AG (a -> AX lamp)",
    "next": "G (a -> X lamp)", "next_two": "G (lamp -> X X lamp)", "last": "X twice",
    "answered": "G (b -> F a)", "soon": "G (a -> F[0ms,25ms] twice)",
    "later": "G (a -> F[10ms,30ms] b)", "holds_on": "G (lamp -> G[0ms,15ms] a)",
    "until": "!twice U b", "until_soon": "G (a -> lamp U[0ms,30ms] b)", "weakly": "!lamp W b",
    "release": "b R !lamp", "again": "G F lamp", "both_again": "G F lamp & G F b",
    "settles": "F G !lamp", "answers": "G F a -> G F twice", "once": "G (lamp -> O b)",
    "since": "G (twice -> !b S[15ms,inf) a)", "before": "G (Y a -> lamp)",
    "pulse": "G (rise(a) -> lamp)", "fell": "G (fall(lamp) -> twice)",
    "long_enough": "lamp lasts at least 25ms", "not_too_long": "lamp lasts at most 25ms",
    "every": "b again every 30ms", "order": "sequence a, lamp, b",
    "not_before": "lamp not before b",
    "leads": "a --> twice", "inevitable": "AF lamp", "returns": "AG EF (n = 3 & b)"}


IN_TIME = {
    "X6_soon": "G (X6.X -> F[0s,31s] !X6.X)", "X3_soon": "G (X3.X -> F[0s,19s] !X3.X)",
    "X2_long": "X2.X lasts at least 1s", "X3_again": "G F X3.X",
    "to_X6": "G (X3.X -> F X6.X)"}
"""Of the evaporator, with `merge: timed`."""


class Case(NamedTuple):
    """A system, and which of its properties are violated."""

    config: Callable[[Path], Config]
    violated: tuple[str, ...]


def tank(version: int, *more: str) -> Callable[[Path], Config]:
    return lambda folder: load_config(TANK, [f"program=version{version}.sipn", *more])


def batch(*overrides: str) -> Callable[[Path], Config]:
    return lambda folder: batch_config(*overrides)


def conflicting(folder: Path) -> Config:
    text = (BATCH / "batch_plant.sfc").read_text(encoding="utf-8")
    mutant = folder / "mutant.sfc"
    mutant.write_text(text.replace("  LD   Psi2\n  ANDN Theta1\n", "  LD   Psi2\n"),
                      encoding="utf-8")
    return batch_config(f"program={mutant}")


def evaporator(folder: Path) -> Config:
    (folder / "in_time.prop").write_text("".join(f"{n}: {f}\n" for n, f in IN_TIME.items()),
                                         encoding="utf-8")
    return load_config(ROOT / "il_programs/evaporator",
                       [f"verify.properties={folder / 'in_time.prop'}", "verify.monitored=false"])


def free(program: str, demands: dict[str, str], merge: str = "none",
         level: str = "[0, 50]") -> Callable[[Path], Config]:
    def make(folder: Path) -> Config:
        (folder / "p.prop").write_text("".join(f"{n}: {f}\n" for n, f in demands.items()),
                                       encoding="utf-8")
        levels = f"\n  parameters: {{level: {level}}}" if "level" in program else ""
        return load_config(write_config(folder, f"""program: main.il
cycle: 10ms
verify:
  abstraction: free_inputs
  merge: {merge}
  properties: p.prop{levels}
""", program))

    return make


MERGED = {name: DEMANDS[name] for name in (
    "never", "either", "first", "answered", "until", "weakly", "again", "settles", "answers",
    "once", "before", "pulse", "fell", "order", "not_before")}

CASES = {
    "tank 2": Case(tank(2), ("property_3",)),
    "tank 3": Case(tank(3), ("outputs_defined", "no_conflict")),
    "tank 4": Case(tank(4), ("outputs_defined", "reversible", "live", "live_each",
                             "deadlock_free", "property_1")),
    "tank 5": Case(tank(5, "verify.properties=intended.prop"), ("property_2_intended",)),
    **{f"batch {load}": Case(batch(f"load={load}"), ("produces",)) for load in (0, 0.5, 7.5, 8)},
    "batch all": Case(batch("initial=loads"), ("produces",)),
    "batch mutant": Case(conflicting, ("no_P1_with_P2", "no_forbidden_mixture", "produces")),
    "lamp": Case(free(LAMP, DEMANDS), tuple(DEMANDS)),
    "lamp merged": Case(free(LAMP, MERGED, "stable"), tuple(MERGED)),
    "evaporator": Case(evaporator, tuple(IN_TIME)),
    "fault": Case(free(DIVIDES, {"rest": "G rest < 50"}, level="[0, 7]"), ("no_fault",)),
    "late": Case(free(LATE, {"in_time": "G (a -> F[0ms,20ms] lamp)", "long": "G (lamp -> a)"}),
                 ("in_time",)),
}
ENDLESS = {"lamp": ("answered", "again", "both_again", "settles", "answers", "leads", "inevitable"),
           "lamp merged": ("answered", "again", "settles", "answers"),
           "evaporator": ("X3_again", "to_X6"),
           **{case: ("produces",) for case in CASES if case.startswith("batch")}}
"""Which of them take a run without end."""
EVERY = [(case, name) for case, (_, names) in CASES.items() for name in names]


class Proved(NamedTuple):
    """A system and its proofs; what is saved of it goes to the folder."""

    folder: Path
    config: Config
    prover: Prover
    proofs: dict[str, Proof]


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Proved]]:
    """Proves a case once."""
    @cache
    def prove(case: str) -> Proved:
        folder = tmp_path_factory.mktemp(case.replace(" ", "_"))
        config = CASES[case].config(folder)
        prover = make_prover(config)
        return Proved(folder, config, prover, {p.name: p for p in prover.prove().proofs})

    yield prove
    prove.cache_clear()


def played(config: Config, saved: Saved, until_ns: int) -> System:
    """The system of a saved counterexample, run so long, as the command line does it."""
    given = {"sipn_single_firing": fires_once(config),
             "properties": [str(saved.properties)] if saved.properties else []}
    system = System(config.model_copy(update=given), with_plant=False,
                    scenario=load_scenario(saved.scenario))
    system.cycle.run_virtual(until_ns)
    return system


@pytest.mark.parametrize("case", CASES)
def test_what_is_violated_is_what_is_listed_here(
        case: str, proved: Callable[[str], Proved]) -> None:
    assert {n for n, p in proved(case).proofs.items() if p.finding.verdict == "violated"} == \
        set(CASES[case].violated)


@pytest.mark.parametrize(("case", "name"), EVERY)
def test_it_prints_as_a_table_and_plays_through_the_same_values(
        case: str, name: str, proved: Callable[[str], Proved]) -> None:
    folder, config, prover, found = proved(case)
    path = found[name].path
    saved = save_counterexample(folder, found[name], prover)
    assert path is not None and saved is not None
    assert path.lines()[0].startswith("  from a cold start")
    system = played(config, saved, (len(path.rows) - 1) * path.cycle_ns + 1)
    tags = {tag.name: value for tag, value in
            zip(system.cycle.tags, system.cycle.values(), strict=True)}
    shown = {tag.name: value for tag, value in
             zip(path.predicates.tags, path.rows[-1].values, strict=True)
             if not tag.name.startswith("plant.") and not tag.name.endswith(".T")}
    assert shown == {tag: tags[tag] for tag in shown}


def is_endless(case: str, name: str) -> bool:
    return name in ENDLESS.get(case, ())


@pytest.mark.parametrize(("case", "name"), [
    (case, name) for case, name in EVERY if not is_endless(case, name) and name != "no_fault"])
def test_the_monitor_violates_at_the_same_instant(
        case: str, name: str, proved: Callable[[str], Proved]) -> None:
    folder, config, prover, found = proved(case)
    path = found[name].path
    saved = save_counterexample(folder, found[name], prover)
    assert path is not None and path.repeats_from is None and saved is not None
    assert (saved.properties is not None) == is_monitored(found[name].formula)
    results = played(config, saved, saved.until_ns).cycle.suite.results()
    ended = [(r.verdict, r.decided_at_ns) for r in results]
    assert ended == ([("violated", path.ends_at_ns)] if saved.properties else [])


@pytest.mark.parametrize(("case", "name"), [
    (case, name) for case, name in EVERY if is_endless(case, name)])
def test_on_a_run_without_end_something_is_owed_again_in_every_round(
        case: str, name: str, proved: Callable[[str], Proved]) -> None:
    """The monitor decides nothing, and cut at some scan of each round the run violates."""
    folder, config, prover, found = proved(case)
    path = found[name].path
    saved = save_counterexample(folder, found[name], prover)
    assert path is not None and path.repeats_from is not None and saved is not None
    system = played(config, saved, 1)
    verdicts = []
    for scan in range(len(path.played(ROUNDS))):
        system.cycle.run_virtual(scan * path.cycle_ns + 1)
        verdicts += [result.verdict for result in system.cycle.suite.results()]
    rounds = len(path.rows) - path.repeats_from
    ends = [verdicts[end - rounds:end] for end in range(len(verdicts), path.repeats_from, -rounds)]
    assert set(verdicts) <= {"presumably satisfied", "presumably violated"}
    assert len(ends) >= 1 and all("presumably violated" in each for each in ends)
