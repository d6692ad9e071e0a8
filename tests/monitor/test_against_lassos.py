"""What the monitor says for good of a beginning is true of every endless run that begins so."""

from __future__ import annotations

from hypothesis import given, settings
from monitor_brute_force import Row
from monitor_lasso import Lasso
from monitor_strategies import formulas, runs, trace_of

from plcemu.monitor import Monitor
from plcemu.monitor.formula import Formula

TRUTH = {"satisfied": True, "violated": False}


@settings(deadline=None, max_examples=60)
@given(formulas, runs, runs)
def test_a_final_verdict_on_a_part_of_an_endless_run_is_its_truth(
        formula: Formula, begin: list[Row], loop: list[Row]) -> None:
    verdict = Monitor(formula).check(trace_of(begin + loop * 3)).verdict
    truth = Lasso(begin, loop, formula).holds(formula, 0)
    assert TRUTH.get(verdict, truth) is truth
