"""SPIN as an independent judge: its verdicts beside ours, its trails executed by our loop."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from spin_toys import Systems, both, mutated, point, random_steps
from systems import BATCH, ROOT, batch_config
from tools import need_spin
from verify_toys import Steps, Tank, can_avoid

from plant_sim.free_inputs import FreeInputs
from plcemu.monitor import Suite, parse_properties
from plcemu.runtime.config import load_config
from plcemu.runtime.second_opinion import Opinion, Row, ask_spin
from plcemu.runtime.verification import make_prover
from plcemu.verify.explore import Limits
from plcemu.verify.promela.code import NoPromela


@pytest.fixture(autouse=True)
def spin() -> None:
    need_spin()


def opinion_of(*overrides: str, names: list[str] | None = None,
               folder: Path = BATCH) -> Opinion:
    config = load_config(folder, overrides)
    prover = make_prover(config, names, recorded=True)
    return ask_spin(prover, prover.prove(), config.name, Limits(seconds=120))


def rows(opinion: Opinion, name: str) -> list[Row]:
    return [row for row in opinion.rows if row.name == name]


# ---------------------------------------------------------------- the batch plant


def test_on_all_thirty_loads_spin_says_what_we_say() -> None:
    opinion = opinion_of("initial=loads",
                         names=["produces", "no_overflow", "no_forbidden_mixture",
                                "no_interruption", "heating_tank_closed"])
    assert not opinion.differs and not opinion.undecided
    produces = rows(opinion, "produces")
    assert len(produces) == 30
    refuted = {row.initial for row in produces if row.answer.verdict == "violated"}
    assert {name.split(" (")[0] for name in refuted} == {"load 0", "load 0.5", "load 7.5",
                                                         "load 8"}
    assert Counter(row.answer.verdict for row in produces) == {"holds": 23, "violated": 7}
    assert all(row.answer.path is not None for row in produces if row.initial in refuted)
    assert Counter(row.answer.verdict for row in opinion.rows) == {"holds": 30 * 5 + 23,
                                                                   "violated": 7}


def test_a_mutant_is_refuted_by_both_and_the_online_monitor(tmp_path: Path) -> None:
    program = mutated(tmp_path, BATCH / "batch_plant.sfc", "  LD   Psi2\n  ANDN Theta1\n",
                      "  LD   Psi2\n")
    opinion = opinion_of(f"program={program}")
    assert not opinion.differs and not opinion.undecided
    refuted = {row.name: row for row in opinion.rows if row.answer.verdict == "violated"}
    assert {"no_P1_with_P2", "no_forbidden_mixture", "produces"} <= refuted.keys()
    formulas = {p.name: p.formula for p in make_prover(batch_config()).properties}
    for name in ("no_P1_with_P2", "no_forbidden_mixture"):
        path = refuted[name].answer.path
        assert path is not None
        trace = path.trace()
        suite = Suite(parse_properties(f"it: {formulas[name]}"), trace.tags)
        for frame in trace.frames:
            suite.observe(frame)
        result, = suite.finish(trace.end_ns)
        assert result.failed and result.decided_at_ns == trace.end_ns


@pytest.mark.parametrize("version", [3, 4])
def test_on_the_heating_tank_with_free_inputs_spin_says_what_we_say(version: int) -> None:
    opinion = opinion_of(f"program=version{version}.sipn",
                         folder=ROOT / "il_programs/heating_tank")
    assert not opinion.differs and not opinion.undecided
    assert sum(row.asked for row in opinion.rows) >= 4
    assert {r.answer.verdict for r in rows(opinion, "outputs_defined")} == {"violated"}


# ---------------------------------------------------------------- fairness


FOLLOWING = """PROGRAM MAIN
VAR here AT %IW0 : INT; was, turns : INT; good, odd : BOOL; END_VAR
  IF here <> was THEN turns := (turns + 1) MOD 3; END_IF;
  was := here;
  good := here MOD 3 = 1;
  odd := turns = 1;
END_PROGRAM
"""


def good(system: Steps) -> set[int]:
    return {n for n in system.table if n % 3 == 1}


def reached(system: Steps) -> set[int]:
    found = {0}
    while more := {t for n in found for t in system.table[n].values()} - found:
        found |= more
    return found


def staying(system: Steps) -> Steps:
    """The system with a step that stays where nothing is pending: there nothing is owed."""
    return Steps({n: {**row, **({} if system.waiting[n] else {"stay": n})}
                  for n, row in system.table.items()}, system.waiting)


def test_on_random_plants_with_weak_fairness_three_judges_agree() -> None:
    systems = [random_steps(seed) for seed in range(40)]
    result, opinion = both(FOLLOWING, Systems(systems), [point("here", "%IW0")], [],
                           "good: G F good\nmoves: AG EX TRUE\nnever: G !odd\nboth: G F good & "
                           "G F turns = 0\nreached: EF (plant.state = 6 & odd)")
    assert not opinion.differs and not opinion.undecided
    by_oracle = {f"system {n}": "violated" if reached(s) & can_avoid(staying(s), good(s))
                 else "holds" for n, s in enumerate(systems)}
    assert {row.initial: row.answer.verdict for row in rows(opinion, "good")} == by_oracle
    for name in ("good", "moves", "never", "both"):
        assert {row.answer.verdict for row in rows(opinion, name)} == {"holds", "violated"}
    assert [p.finding.verdict for p in result.proofs if p.name == "reached"] == ["holds"]


CAREFUL = """PROGRAM MAIN
VAR high AT %IX0.0 : BOOL; valve AT %QX0.0 : BOOL; was : BOOL; n, k : INT; END_VAR
  valve := NOT high;
  IF high AND NOT was THEN n := n + 1; k := 10 / (3 - n); END_IF;
  was := high;
END_PROGRAM
"""


@pytest.mark.parametrize("merge", ["stable", "none"])
def test_faults_and_what_follows_them_are_the_same(merge: str) -> None:
    result, opinion = both(
        CAREFUL, Tank(), [point("high", "%IX0.0")], [point("valve", "%QX0.0")],
        "dry: G !plant.overflow\nhigh: G F high\nlow: G F !high\nends: AG EX TRUE\ntwo: EF k = 10",
        merge=merge)
    assert not opinion.differs and not opinion.undecided
    fault, = rows(opinion, "no_fault")
    assert fault.answer.verdict == "violated" and fault.answer.path is not None
    assert fault.answer.path.fault.startswith("division by zero")
    assert next(p.name for p in result.proofs) == "no_fault"


FAULTY = """PROGRAM MAIN
VAR high AT %IX0.0 : BOOL; valve AT %QX0.0 : BOOL; lit : BOOL; k : INT; END_VAR
  valve := TRUE;
  lit := ANSWER;
  IF high THEN k := 1 / k; END_IF;
END_PROGRAM
"""


@pytest.mark.parametrize(("lit", "verdict"), [("TRUE", "holds"), ("FALSE", "violated")])
@pytest.mark.parametrize("merge", ["stable", "none"])
def test_after_a_fault_memory_stays_as_before_the_scan(merge: str, lit: str,
                                                       verdict: str) -> None:
    _, opinion = both(FAULTY.replace("ANSWER", lit), Tank(), [point("high", "%IX0.0")],
                      [point("valve", "%QX0.0")], "lit: G F lit", merge=merge)
    assert not opinion.differs and not opinion.undecided
    assert [row.answer.verdict for row in opinion.rows] == ["violated", verdict]


LINEAR = """until: plant.state = 0 U here > 0
weak: here < 3 W odd
release: odd R here < 6
respond: G (good -> F odd)
settles: F G !good
goes: (G F good) -> (G F odd)
either: (G here < 4) <-> (F turns = 2)
neither: !(good U (odd | here = 5))
next: G (good -> X !good)
"""


def test_formulas_of_ltl_are_judged_alike_where_every_scan_is_a_state() -> None:
    systems = [random_steps(seed) for seed in range(100, 125)]
    _, opinion = both(FOLLOWING, Systems(systems), [point("here", "%IW0")], [], LINEAR,
                      merge="none")
    assert not opinion.differs and not opinion.undecided
    asked = {row.name for row in opinion.rows if row.asked}
    assert asked == {"no_fault", "until", "weak", "release", "respond", "settles", "goes", "either",
                     "neither"}
    assert sum(row.answer.verdict == "violated" for row in opinion.rows) > 30
    assert sum(row.answer.verdict == "holds" for row in opinion.rows) > 60


# ---------------------------------------------------------------- free inputs


COUNTING = """PROGRAM MAIN
VAR up AT %IX0.0 : BOOL; level AT %IW1 : INT; edge : R_TRIG; n : SINT;
  a : ARRAY [0..3] OF BYTE; END_VAR
  edge(CLK := up);
  IF edge.Q THEN n := n + 60; a[ABS(n) MOD 4] := BYTE#16#81 XOR a[1]; END_IF;
  IF level < 0 AND n > 0 THEN n := n / 2; END_IF;
END_PROGRAM
"""


@pytest.mark.parametrize("merge", ["stable", "none"])
def test_with_free_inputs_spin_says_what_we_say(merge: str) -> None:
    plant = FreeInputs({"up": [False, True], "level": [-5, 3]})
    reached = (-128, -68, -8, 0, 7, 60, 92, 120, 121)
    demands = [f"v{number}: EF n = {n}" for number, n in enumerate(reached)]
    demands += ["a1: G !(a[3] = 16#81)", "a2: EF (a[1] = 16#81 & a[2] = 0)", "a3: G a[0] < 200",
                "again: G F n = 0", "same: G (MAIN.level = plant.level)"]
    _, opinion = both(COUNTING, plant,
                      [point("up", "%IX0.0"), point("level", "%IW1")], [], "\n".join(demands),
                      merge=merge)
    assert not opinion.differs and not opinion.undecided
    assert all(row.asked for row in opinion.rows)
    assert {row.answer.verdict for row in opinion.rows} == {"holds", "violated"}


# ---------------------------------------------------------------- what cannot be said


@pytest.mark.parametrize(("declared", "body", "why"), [
    ("r : REAL;", "IF high THEN r := 0.5; END_IF; x := r > 0.3;",
     r"^<text>:3:\d+: MAIN.r is of type f32"),
    ("n : LINT;", "n := (n + 1) MOD 4; x := n > 2;", r"^<text>:3:\d+: MAIN.n of type i64"),
    ("z : STRING[5];", "z := CONCAT(z, 'a'); x := LEN(z) > 3;", r"^<text>:3:\d+: an address"),
])
def test_what_promela_lacks_is_refused_with_place_and_reason(declared: str, body: str,
                                                             why: str) -> None:
    text = ("PROGRAM MAIN VAR x AT %QX0.0 : BOOL; high AT %IX0.0 : BOOL;\n"
            f"{declared} END_VAR\n{body}\nEND_PROGRAM")
    with pytest.raises(NoPromela, match=why):
        both(text, Tank(), [point("high", "%IX0.0")], [point("valve", "%QX0.0")], "x: G !x",
             merge="none")


def test_what_the_cone_of_influence_cuts_away_may_be_anything() -> None:
    text = """PROGRAM MAIN
    VAR high AT %IX0.0 : BOOL; valve AT %QX0.0 : BOOL; r : LREAL; n : LINT; END_VAR
      r := r * 1.5 + 0.1; n := n + 1; valve := NOT high;
    END_PROGRAM"""
    _, opinion = both(text, Tank(), [point("high", "%IX0.0")], [point("valve", "%QX0.0")],
                      "dry: G !plant.overflow\nfull: EF high")
    assert not opinion.differs and not opinion.undecided
    assert {row.answer.verdict for row in opinion.rows} == {"holds"}


def test_a_property_with_numbers_beyond_32_bits_is_not_asked_but_the_others_are() -> None:
    _, opinion = both(CAREFUL, Tank(), [point("high", "%IX0.0")], [point("valve", "%QX0.0")],
                      "large: G n * 100000 < 2147483647\ndry: G !plant.overflow")
    assert [(row.name, row.asked) for row in opinion.rows] == [
        ("no_fault", True), ("large", False), ("dry", True)]
    assert "32 bits" in rows(opinion, "large")[0].answer.reason
