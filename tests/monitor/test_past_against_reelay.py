"""Formulas of the past get the same value at every instant from reelay, a monitor in C++.

reelay (https://github.com/doganulus/reelay) reads past operators over discrete time; with one
sample a ns both speak of the same instants.
"""

from __future__ import annotations

import reelay
from hypothesis import given, settings
from hypothesis import strategies as st
from monitor_brute_force import Row
from monitor_strategies import A, B, some_interval, trace_of

from plcemu.monitor import Monitor
from plcemu.monitor.formula import Binary, Formula, Interval, TagRef, Unary

# reelay takes [0:0] for "without end".
longer = some_interval.filter(lambda interval: interval is None or interval.last_ns != 0)
pasts: st.SearchStrategy[Formula] = st.recursive(st.sampled_from([A, B]), lambda inner: st.one_of(
    st.builds(Unary, st.sampled_from(["!", "Y"]), inner),
    st.builds(Unary, st.just("O"), inner, longer),
    st.builds(Binary, st.sampled_from(["&", "|", "->"]), inner, inner),
    st.builds(Binary, st.just("S"), inner, inner, longer)), max_leaves=5)
boolean_runs = st.lists(st.fixed_dictionaries({"a": st.booleans(), "b": st.booleans(),
                                               "n": st.just(0)}), min_size=1, max_size=12)
_WORDS = {"!": "not", "Y": "pre", "O": "once", "&": "and", "|": "or", "->": "->", "S": "since"}


def translated(formula: Formula) -> str:
    """Return the formula in reelay's words."""
    if isinstance(formula, TagRef):
        return f"{{{formula.name}}}"
    assert isinstance(formula, (Unary, Binary))
    word = _WORDS[formula.op]
    if formula.op in ("O", "S"):
        interval = formula.interval or Interval()
        word += f"[{interval.first_ns}:{'' if interval.last_ns is None else interval.last_ns}]"
    if isinstance(formula, Unary):
        return f"{word} ({translated(formula.arg)})"
    return f"(({translated(formula.left)}) {word} ({translated(formula.right)}))"


@settings(deadline=None, max_examples=40)
@given(pasts, boolean_runs)
def test_a_formula_of_the_past_is_violated_where_reelay_first_says_no(
        formula: Formula, run: list[Row]) -> None:
    peer = reelay.discrete_timed_monitor(pattern=translated(formula), semantics="boolean",
                                         condense=False)
    values = [peer.update({"a": row["a"], "b": row["b"]})["value"] for row in run]
    found = Monitor(Unary("G", formula)).check(trace_of(run))
    # What is certain to come is a violation already; reelay says no when it has come.
    broken = found.violation.trigger_ns if found.violation else None
    seen = broken if broken in range(len(run)) else None
    assert seen == (values.index(False) if False in values else None)
