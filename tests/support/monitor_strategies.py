"""Random formulas and runs for the monitor's property tests."""

from __future__ import annotations

from hypothesis import strategies as st
from monitor_brute_force import Row

from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.monitor.formula import Binary, Formula, Interval, Literal, TagRef, Unary

TAGS = TagTable([Tag("a", "BOOL"), Tag("b", "BOOL"), Tag("n", "INT")])
A, B, N = TagRef("a"), TagRef("b"), TagRef("n")

comparisons = st.builds(Binary, st.sampled_from(["=", "<", ">="]), st.just(N),
                        st.integers(0, 2).map(Literal))
basics: st.SearchStrategy[Formula] = st.one_of(st.sampled_from([A, B]), comparisons)
pulses = st.one_of(
    st.builds(Unary, st.sampled_from(["rise", "fall"]), basics),
    st.builds(Unary, st.just("changed"), st.just(N)))
leaves: st.SearchStrategy[Formula] = st.one_of(basics, basics, pulses, st.just(Literal(True)))
states = st.recursive(leaves, lambda inner: st.one_of(
    st.builds(Unary, st.just("!"), inner),
    st.builds(Binary, st.sampled_from(["&", "|", "->", "<->"]), inner, inner)), max_leaves=3)


@st.composite
def intervals(draw: st.DrawFn, longest_ns: int = 4) -> Interval:
    """Draw an interval that holds an instant."""
    low = draw(st.integers(0, longest_ns))
    high = draw(st.one_of(st.none(), st.integers(low, longest_ns + 1)))
    closed = high == low
    open_high = high is None or (not closed and high > low + 1 and draw(st.booleans()))
    return Interval(low, high, closed or draw(st.booleans()), not open_high)


some_interval = st.one_of(st.none(), intervals())


def _grown(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    return st.one_of(
        st.builds(Unary, st.just("!"), inner),
        st.builds(Unary, st.just("Y"), inner),
        st.builds(Unary, st.sampled_from(["G", "F", "O", "H"]), inner, some_interval),
        st.builds(Binary, st.sampled_from(["&", "|", "->", "<->"]), inner, inner),
        st.builds(Binary, st.sampled_from(["U", "W", "R", "S"]), inner, inner, some_interval))


formulas: st.SearchStrategy[Formula] = st.recursive(states, _grown, max_leaves=4)


def _always(body: Formula) -> Formula:
    return Unary("G", body)


from_now = st.one_of(st.none(), st.integers(0, 6).map(lambda b: Interval(0, b, True, True)))
nearby = st.sampled_from(["F", "O"])
responses: st.SearchStrategy[Formula] = st.one_of(
    states.map(_always),
    st.builds(Binary, st.just("->"), states, states).map(_always),
    st.builds(Unary, nearby, states, from_now).map(_always),
    st.builds(Binary, st.just("->"), states, st.builds(Unary, nearby, states, from_now),
              ).map(_always))

rows = st.fixed_dictionaries({"a": st.booleans(), "b": st.booleans(), "n": st.integers(0, 2)})
runs: st.SearchStrategy[list[Row]] = st.lists(
    st.tuples(rows, st.integers(1, 4)), min_size=1, max_size=5,
).map(lambda parts: [row for row, length in parts for _ in range(length)])


def frames_of(run: list[Row], start_ns: int = 0) -> list[Frame]:
    """Return a frame for each instant at which a run changes."""
    names = [tag.name for tag in TAGS]
    rows_before: list[Row] = [{}, *run]
    changes = [tuple((i, row[name]) for i, name in enumerate(names) if row[name] != last.get(name))
               for last, row in zip(rows_before, run, strict=False)]
    return [Frame(start_ns + t, t, change) for t, change in enumerate(changes) if change]


def trace_of(run: list[Row], start_ns: int = 0) -> Trace:
    """Return a run as a trace that is cut after its last instant."""
    return Trace(TAGS, frames_of(run, start_ns), start_ns + len(run) - 1)
