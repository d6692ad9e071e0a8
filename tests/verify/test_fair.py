"""Fair cycles, against fixed points computed over sets of states."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from verify_toys import NAMES, Steps, can_avoid, steps

from plcemu.verify.explore import explore, terminal
from plcemu.verify.fair import fair_components, lasso


@settings(max_examples=200, deadline=None)
@given(steps(), st.frozensets(st.integers(0, 6)))
def test_a_fair_run_avoids_the_good_states_exactly_if_fixed_points_say_so(
        system: Steps, good: frozenset[int]) -> None:
    graph = explore(system)
    outside = {n for n, state in enumerate(graph.states) if state not in good}
    stays = list(fair_components(graph, system, outside.__contains__))
    rests = [n for n in terminal(graph) if n in outside]
    found = {graph.states[n] for n in [*(n for c in stays for n in c), *rests]}
    reaching = {s for s in graph.states if s in can_avoid(system, good)}
    assert bool(found) == bool(reaching)
    assert found <= reaching


@settings(max_examples=200, deadline=None)
@given(steps())
def test_a_lasso_is_a_run_and_its_cycle_is_fair(system: Steps) -> None:
    graph = explore(system)
    for component in fair_components(graph, system, lambda n: True):
        run = lasso(graph, system, component)
        here = run.start
        for step in run.stem:
            assert graph.number[system.next(graph.states[here], step.action)] == step.target
            here = step.target
        knot = here
        passed, done = [], set()
        for step in run.cycle:
            assert graph.number[system.next(graph.states[here], step.action)] == step.target
            here = step.target
            passed.append(graph.states[here])
            done.add(step.action)
        assert here == knot and run.cycle
        assert all(name in done or any(name not in system.waiting[s] for s in passed)
                   for name in NAMES)


def test_without_fairness_every_cycle_counts() -> None:
    idle = Steps({0: {"a": 0, "b": 1}, 1: {}}, {0: frozenset("b"), 1: frozenset()})
    graph = explore(idle)
    assert list(fair_components(graph, None, lambda n: True)) == [[0]]
    assert list(fair_components(graph, idle, lambda n: True)) == []
