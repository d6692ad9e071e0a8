"""The examples of docs/properties.md are read and judged, and its patterns expand as it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame, Trace
from plcemu.monitor import judge, parse_formula, parse_properties, parse_property
from plcemu.monitor.patterns import PATTERNS

PAGE = (Path(__file__).parents[2] / "docs" / "properties.md").read_text(encoding="utf-8")
TAGS = TagTable([
    Tag("MAIN.malf", "BOOL"), Tag("MAIN.heater", "BOOL", address="%QX0.1"),
    Tag("MAIN.level[1]", "REAL"), Tag("MAIN.level[2]", "REAL"), Tag("MAIN.n", "INT"),
    Tag("MAIN.mode", "DINT", values=(("IDLE", 0), ("HEATING", 1))), Tag("MAIN.word", "WORD"),
    Tag("MAIN.START.X", "BOOL"), Tag("MAIN.HEAT.X", "BOOL"), Tag("MAIN.HEAT.T", "TIME"),
    Tag("plant.overflow", "BOOL")])
S = 1_000_000_000


def rows(*moments: tuple[float, dict[str, object]]) -> list[Frame]:
    return [Frame(round(t * S), n, tuple((TAGS.find(k), v) for k, v in changes.items()))
            for n, (t, changes) in enumerate(moments)]


RUN = Trace(TAGS, rows(
    (0, {"malf": False, "heater": False, "level[1]": 10.0, "level[2]": 20.0, "n": 1, "mode": 0,
         "word": 5, "START.X": True, "HEAT.X": False, "HEAT.T": 0, "overflow": False}),
    (1, {"START.X": False}),
    (4, {"heater": True, "HEAT.X": True, "mode": 1}),
    (7, {"malf": True, "heater": False, "HEAT.X": False, "HEAT.T": 3 * S}),
    (10, {"malf": False, "level[1]": 30.0}), (14, {"n": 2})), 20 * S)
EXAMPLES = [entry for block in re.findall(r"```prop\n(.*?)```", PAGE, re.DOTALL)
            for entry in parse_properties(block)]
WORDS = re.findall(r"^\| `([^`]+)` \| (.+?) \| [^|]+ \|$", PAGE.split("## Formulas")[0],
                   re.MULTILINE)


@pytest.mark.parametrize("entry", EXAMPLES, ids=lambda entry: entry.name)
def test_an_example_of_the_page_is_judged_and_holds_so_far(entry) -> None:
    result = judge(RUN, [entry])[0]
    assert result.verdict in ("satisfied", "presumably satisfied") or entry.name in OWED
    assert result.verdict != "inconclusive"


OWED = {"always_and_at_last"}
"""Demands something again and again, and so owes it at every cut."""


@pytest.mark.parametrize(("words", "formula"), [
    (words, cell[1:-1]) for words, cell in WORDS if cell.startswith("`")])
def test_a_pattern_of_the_page_expands_as_it_says(words: str, formula: str) -> None:
    assert str(parse_property(words).formula) == formula.replace("\\|", "|")


def test_the_page_shows_every_pattern() -> None:
    def shape(words: str) -> str:
        return re.sub(r"\{[^}]*\}|\b([ABCx]|\d+s?)\b", "_", words).replace("_, _, _", "_")

    assert {shape(p.words) for p in PATTERNS} == {shape(words) for words, _ in WORDS}


def test_a_result_shows_the_words_and_their_meaning_beside_the_formula() -> None:
    document = judge(RUN, parse_properties('a "why": malf causes !heater within 1s'))[0].as_json()
    assert document["pattern"] == "malf causes !heater within 1s"
    assert document["formula"] == "G (malf -> F[0s,1s] !heater)"
    assert document["meaning"] == (
        "Whenever malf is true, !heater is true at some instant from then to 1s later.")


def orders(*events: str) -> Trace:
    """Return a run in which A, B and C become true for a while, one after another."""
    tags = TagTable([Tag(name, "BOOL") for name in "ABC"])
    frames = [Frame(0, 0, tuple((i, False) for i in range(3)))]
    for n, name in enumerate(events, 1):
        index = tags.find(name)
        frames += [Frame(2 * n * S, 2 * n, ((index, True),)),
                   Frame((2 * n + 1) * S, 2 * n + 1, ((index, False),))]
    return Trace(tags, frames, 100 * S)


@pytest.mark.parametrize(("words", "good", "bad"), [
    ("never both A and B", "AB", ""),
    ("at most one of A, B, C", "ABC", ""),
    ("A not before B", "BA", "AB"),
    ("after A until B never C", "CABCA", "AC"),
    ("after A never C", "CAB", "AC"),
    ("sequence A, B, C", "ABCABCA", "ABAC"),
    ("sequence A, B, C", "", "B"),
    ("A lasts at most 1s", "ABA", ""),
    ("A lasts at least 1s", "ABA", ""),
    ("A lasts at least 2s", "BC", "A"),
    ("A lasts at most 999ms", "BC", "A"),
    ("A again every 94s", "ABCA", "BC"),
    ("A causes B within 2s", "AB", "AC"),
    ("A only while FALSE", "B", "A"),
    ("A changes at most 0 per 1s", "B", "A"),
])
def test_a_pattern_tells_good_runs_from_bad_ones(words: str, good: str, bad: str) -> None:
    entry = parse_property(words)
    assert judge(orders(*good), [entry])[0].verdict in ("satisfied", "presumably satisfied")
    assert bad == "" or judge(orders(*bad), [entry])[0].verdict == "violated"


PAPERS = {
    "batch plant, property (1)": ("□◇(B3 = sol70C) ∧ □◇(B3 = empty)",
                                  "G F B3 = sol70C & G F B3 = empty"),
    "batch plant, as SPIN writes it": ("[]<> B3_sol70C && []<> B3_empty",
                                       "G F B3_sol70C & G F B3_empty"),
    "batch plant, Figure 7": ("never both P1.X and P2.X", "G !(P1.X & P2.X)"),
    "evaporator, PC1": ("A[] !deadlock", "AG !deadlock"),
    "evaporator, PC2": ("E<> X1", "EF X1"),
    "evaporator, PS1": ("A[ ] not condenser.explosion", "AG !condenser.explosion"),
    "evaporator, 22 s": ("G (Malf -> F[0s,22s] !H)", "G (Malf -> F[0s,22s] !`H`)"),
    "heating tank, 4.1 (1)": ("AG EF eoc", "AG EF eoc"),
    "heating tank, 4.1 (2)": (
        "AG !(eoc & ((set_o1 & reset_o1) | (!set_o1 & !reset_o1)))",
        "AG !(eoc & (set_o1 & reset_o1 | !set_o1 & !reset_o1))"),
    "heating tank, 4.1 (3)": ("AG !(T2 & T3)", "AG !(T2 & T3)"),
    "heating tank, 4.1 (4)": ("AG EF m0", "AG EF m0"),
    "heating tank, 4.1 (5)": ("AG ((EF T1) | (EF T2) | (EF T3) | (EF T4) | (EF T5))",
                              "AG (EF T1 | EF T2 | EF T3 | EF T4 | EF T5)"),
    "heating tank, no deadlock": ("AG EF (T1 | T2 | T3 | T4 | T5)",
                                  "AG EF (T1 | T2 | T3 | T4 | T5)"),
    "heating tank, property 1": ("AG ((o1 | o2 | o4) → o3)", "AG (o1 | o2 | o4 -> o3)"),
    "heating tank, property 2": ("AG (m0 & !i1 & !i2 & i4 & eoc → AX o1)",
                                 "AG (m0 & !i1 & !i2 & i4 & eoc -> AX o1)"),
    "heating tank, property 3": ("AG (i5 & eoc → AX (!o1 & !o2 & !o3 & !o4))",
                                 "AG (i5 & eoc -> AX (!o1 & !o2 & !o3 & !o4))"),
    "conveyor, the axis stops in": ("AG (stopped -> 83.182 <= X & X <= 84.018)",
                                    "AG (stopped -> 83.182 <= `X` & `X` <= 84.018)"),
}


@pytest.mark.parametrize(("said", "printed"), PAPERS.values(), ids=PAPERS.keys())
def test_a_formula_of_the_papers_is_read_as_it_is_printed_there(said: str, printed: str) -> None:
    assert str(parse_formula(said)) == printed
    assert parse_formula(printed) == parse_formula(said)
