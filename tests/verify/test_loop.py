"""The closed loop of real scans and a finite plant: a tank filled by a program."""

from __future__ import annotations

from fractions import Fraction

import pytest
from verify_toys import Tank

from plcemu.base.areas import parse_address
from plcemu.base.errors import CompileError, PlcemuError
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.lang.compile import compile_program
from plcemu.monitor import Suite, parse_properties
from plcemu.monitor.verdict import Verdict
from plcemu.verify.explore import Limits
from plcemu.verify.prove import Proof, Prover

HIGH = Point("high", parse_address("%IX0.0"), Fraction(1))
VALVE = Point("valve", parse_address("%QX0.0"), Fraction(1))

CAREFUL = """PROGRAM MAIN
VAR high AT %IX0.0 : BOOL; valve AT %QX0.0 : BOOL; closed : INT; END_VAR
  LDN high
  ST  valve
  LD  high
  JMPCN done
  LD  closed
  ADD 1
  ST  closed
done:
END_PROGRAM
"""
ALWAYS = """PROGRAM MAIN
VAR valve AT %QX0.0 : BOOL; high AT %IX0.0 : BOOL; END_VAR
valve := TRUE;
END_PROGRAM
"""
DIVIDING = """PROGRAM MAIN
VAR valve AT %QX0.0 : BOOL; high AT %IX0.0 : BOOL; n : INT; END_VAR
valve := NOT high;
IF high THEN n := 1 / n; END_IF;
END_PROGRAM
"""
TIMED = """PROGRAM MAIN
VAR high AT %IX0.0 : BOOL; valve AT %QX0.0 : BOOL; late : TON; END_VAR
late(IN := high, PT := T#30ms);
valve := NOT late.Q;
END_PROGRAM
"""
BLINKING = """PROGRAM MAIN
VAR high AT %IX0.0 : BOOL; valve AT %QX0.0 : BOOL; END_VAR
valve := NOT valve;
END_PROGRAM
"""

DEMANDS = """dry: G !plant.overflow
closed: G !(high & valve)
reached: EF high
full: G F high
never: G !high
"""


def prover(program: str, demands: str = DEMANDS, **options: str) -> Prover:
    return Prover(Resource(compile_program(program), 10_000_000), Tank(), [HIGH], [VALVE],
                  10_000_000, parse_properties(demands), **options)  # type: ignore[arg-type]


def proofs(program: str, demands: str = DEMANDS, **options: str) -> dict[str, Proof]:
    result = prover(program, demands, **options).prove(Limits(seconds=60))
    return {p.name: p for p in result.proofs}


def verdicts(program: str, demands: str = DEMANDS, **options: str) -> dict[str, str]:
    return {name: p.finding.verdict for name, p in proofs(program, demands, **options).items()}


def test_what_the_careful_program_guarantees_holds() -> None:
    found = verdicts(CAREFUL)
    assert (found["dry"], found["closed"], found["reached"]) == ("holds",) * 3
    assert found["never"] == "violated"


def test_a_drain_that_need_not_stop_refutes_that_the_tank_is_full_again_and_again() -> None:
    path = proofs(CAREFUL)["full"].path
    assert path is not None and path.repeats_from is not None
    assert {row.action for row in path.rows} >= {"rises", "falls"}


def test_a_valve_that_is_always_open_runs_over_and_the_way_is_a_shortest_one() -> None:
    path = proofs(ALWAYS)["dry"].path
    assert path is not None
    assert [row.action for row in path.rows if row.action] == ["rises"] * 3


def test_the_online_monitor_violates_at_the_instant_of_the_counterexample() -> None:
    for program in (CAREFUL, ALWAYS):
        for proof in proofs(program).values():
            if proof.path is None or proof.path.repeats_from or proof.finding.verdict == "holds":
                continue
            trace = proof.path.trace()
            suite = Suite(parse_properties(f"it: {proof.formula}"), trace.tags)
            for frame in trace.frames:
                suite.observe(frame)
            judged = suite.finish(trace.end_ns)[0]
            assert judged.verdict is Verdict.VIOLATED
            assert judged.decided_at_ns == trace.end_ns


def test_a_counter_is_cut_away_and_said_to_be() -> None:
    assert any("MAIN.closed" in cut for cut in prover(CAREFUL).cuts)


def test_every_scan_as_a_state_gives_the_same_verdicts_here() -> None:
    demands = "".join(DEMANDS.splitlines(keepends=True)[:3])
    merged = verdicts(CAREFUL, demands)
    every = verdicts(CAREFUL, demands, merge="none")
    assert every == {**merged, "dry": "holds"}


def test_a_late_valve_runs_over_only_where_time_passes_between_events() -> None:
    assert verdicts(TIMED, "dry: G !plant.overflow", merge="none") == {"dry": "violated"}


def test_timers_refuse_merged_scans() -> None:
    with pytest.raises(PlcemuError, match="time matters"):
        prover(TIMED)


def test_a_program_that_never_rests_refuses_merged_scans() -> None:
    with pytest.raises(PlcemuError, match="merge: none"):
        verdicts(BLINKING)


def test_a_fault_is_a_violation_of_its_own_with_the_way_to_it() -> None:
    fault = proofs(DIVIDING)["no_fault"]
    assert fault.finding.verdict == "violated"
    assert fault.path is not None and "division by zero" in fault.path.fault


def test_a_premise_that_is_never_true_is_reported() -> None:
    found = proofs(CAREFUL, "a: G (high & valve -> plant.overflow)\nb: G (high -> !valve)")
    assert found["a"].finding.vacuous_in == ("high & valve is never true",)
    assert found["b"].finding.vacuous_in == ()


@pytest.mark.parametrize(("formula", "reason"), [
    ("G (high -> F[0s,1s] !valve)", "durations"), ("G (high -> X !valve)", "counts scans"),
    ("AG EF high", "every scan"), ("AG F high", "mixes AG"), ("G changed(closed)", "numbers"),
    ("G ago(closed, 1s) = 0", "ago"),
    ("G O (high U F[0s,1s] valve)", "has durations in it")])
def test_a_formula_that_no_check_takes_is_inconclusive_and_told_why(formula: str,
                                                                   reason: str) -> None:
    finding = proofs(CAREFUL, f"it: {formula}")["it"].finding
    assert finding.verdict == "inconclusive" and reason in finding.reason


def test_a_limit_is_inconclusive_and_never_holds() -> None:
    result = prover(CAREFUL, "dry: G !plant.overflow").prove(Limits(states=1))
    assert result.proofs[0].finding.verdict == "inconclusive"
    assert "1 states" in result.proofs[0].finding.reason


def test_a_misspelt_tag_is_a_mistake_with_its_place() -> None:
    with pytest.raises(CompileError, match="higgh"):
        prover(CAREFUL, "x: G !higgh")


def test_both_engines_give_the_same_graph() -> None:
    program = compile_program(CAREFUL)
    graphs = [Prover(Resource(program, 10_000_000, engine), Tank(), [HIGH], [VALVE], 10_000_000,
                     parse_properties(DEMANDS)).prove().graph for engine in ("interpreter", "wasm")]
    assert graphs[0].states == graphs[1].states
