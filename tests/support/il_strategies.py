"""Random Boolean IL bodies: jumps forwards, parentheses, latches, conditional returns."""

from hypothesis import strategies as st
from il_oracle import Line

NAMES = ["a", "b", "c", "d"]

variables = st.sampled_from(NAMES)
loads = st.builds(Line, st.just("LD"), st.booleans(), variables)
stores = st.builds(Line, st.just("ST"), st.booleans(), variables)
latches = st.builds(Line, st.sampled_from(["S", "R"]), st.just(False), variables)
logic = st.builds(Line, st.sampled_from(["AND", "OR", "XOR"]), st.booleans(), variables)
inversions = st.builds(Line, st.just("NOT"))
returns = st.builds(Line, st.just("RETC"), st.booleans())
simple = st.one_of(loads, stores, latches, logic, inversions)


def deferred(inner: st.SearchStrategy[Line]) -> st.SearchStrategy[Line]:
    nested = st.tuples(loads, st.lists(inner, max_size=3)).map(lambda pair: (pair[0], *pair[1]))
    return st.builds(Line, st.sampled_from(["AND", "OR", "XOR"]), st.booleans(), nested)


instructions = st.one_of(simple, returns, st.recursive(logic, deferred, max_leaves=4))


@st.composite
def bodies(draw: st.DrawFn) -> tuple[Line, ...]:
    """A body that begins with LD and jumps forwards only."""
    lines = [draw(loads), *draw(st.lists(instructions, min_size=1, max_size=14))]
    end = len(lines)
    for at in draw(st.sets(st.integers(1, end - 1), max_size=5)):
        op = draw(st.sampled_from(["JMP", "JMPC"]))
        negated = op == "JMPC" and draw(st.booleans())
        lines[at] = Line(op, negated, "", draw(st.integers(at + 1, end)))
    return tuple(lines)
