"""Exploration: every state once, shortest ways, limits that are told."""

from __future__ import annotations

from hypothesis import given, settings
from verify_toys import Steps, steps

from plcemu.verify.explore import Limits, Progress, explore, terminal
from plcemu.verify.fair import run_to


class Grid:
    """Two counters that step up to 40 each."""

    def initial(self) -> list[tuple[int, int]]:
        return [(0, 0)]

    def actions(self, state: tuple[int, int]) -> list[str]:
        return [name for name, value in zip("xy", state, strict=True) if value < 40]

    def next(self, state: tuple[int, int], action: str) -> tuple[int, int]:
        x, y = state
        return (x + 1, y) if action == "x" else (x, y + 1)


def test_every_state_and_transition_is_found_once() -> None:
    graph = explore(Grid())
    assert graph.complete
    assert len(graph) == len(graph.number) == 41 * 41
    assert graph.edges == 2 * 40 * 41


def test_breadth_first_the_way_to_a_state_is_a_shortest_one() -> None:
    graph = explore(Grid())
    start, way = run_to(graph, graph.number[13, 29])
    assert graph.states[start] == (0, 0)
    assert len(way) == 42


def test_depth_first_finds_the_same_states() -> None:
    assert set(explore(Grid(), order="dfs").states) == set(explore(Grid()).states)


def test_only_the_corner_is_terminal() -> None:
    graph = explore(Grid())
    assert [graph.states[n] for n in terminal(graph)] == [(40, 40)]


def test_a_limit_of_states_is_told_and_the_graph_is_not_complete() -> None:
    graph = explore(Grid(), Limits(states=100))
    assert not graph.complete
    assert graph.reason == "the limit of 100 states was reached"


def test_a_limit_of_time_is_told() -> None:
    graph = explore(Grid(), Limits(seconds=0.0))
    assert graph.reason == "the limit of 0 s was reached"


def test_a_limit_of_memory_is_told() -> None:
    graph = explore(Grid(), Limits(memory_mb=1))
    assert graph.reason == "the limit of 1 MB was reached"


def test_a_search_ends_at_what_it_looks_for() -> None:
    graph = explore(Grid(), found=lambda number, state: state == (3, 0))
    assert not graph.complete
    assert (3, 0) in graph.number and len(graph) < 20


def test_progress_tells_states_rate_frontier_and_memory() -> None:
    told: list[Progress] = []
    explore(Grid(), on_progress=told.append)
    assert [p.states for p in told] == sorted(p.states for p in told)
    assert all(p.frontier and p.memory_mb and p.rate for p in told)
    assert "states/s" in str(told[0])


@settings(deadline=None)
@given(steps())
def test_what_is_reached_is_what_a_fixed_point_reaches(system: Steps) -> None:
    reached = {0}
    while more := {t for s in reached for t in system.table[s].values()} - reached:
        reached |= more
    assert set(explore(system).states) == reached
