"""The text of formulas: what is read, what is printed, and what is said about mistakes."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from monitor_strategies import intervals

from plcemu.base.errors import CompileError
from plcemu.base.time import NS_PER_S
from plcemu.monitor import load_properties, parse_formula, parse_properties
from plcemu.monitor.formula import (
    FUNCTIONS,
    OPERATORS,
    Binary,
    Call,
    Deadlock,
    Duration,
    Element,
    Formula,
    Group,
    Interval,
    Literal,
    Operator,
    TagRef,
    Unary,
)

P, Q, R = TagRef("p"), TagRef("q"), TagRef("r")
names = st.sampled_from(["p", "MAIN.FILL.X", "plant.B1.overflow", "a[3].b", "G", "two words", "inf",
                         "rise", "%IX0.0", "x_1"])
leaves: st.SearchStrategy[Formula] = st.one_of(
    st.builds(TagRef, names), st.builds(Duration, st.integers(0, 2 ** 50)),
    st.builds(Literal, st.one_of(st.booleans(), st.integers(0), st.floats(0, 1e300),
                                 st.text(st.characters(exclude_categories=["Cc", "Cs"])))),
    st.just(Deadlock()))


def _node(row: Operator, inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    timed = st.one_of(st.none(), intervals(10 ** 12)) if row.timed or row.group is Group.PATH \
        else st.none()
    operands = [inner] if row.group in (Group.PREFIX, Group.CALL) else [inner, inner]
    return st.builds((Unary if len(operands) == 1 else Binary), st.just(row.name), *operands, timed)


def _grown(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    calls = [st.builds(Call, st.just(name), st.lists(
        inner, min_size=fewest, max_size=most or 3).map(tuple))
        for name, (fewest, most) in FUNCTIONS.items()]
    # An index that is a number belongs to the name.
    elements = st.builds(Element, st.sampled_from(["p", "two words", "A.b"]),
                         st.tuples(st.builds(Binary, st.just("+"), inner, inner)),
                         st.sampled_from(["", ".x", ".x.y"]))
    return st.one_of([*(_node(row, inner) for row in OPERATORS.values()), *calls, elements])


trees: st.SearchStrategy[Formula] = st.recursive(leaves, _grown, max_leaves=8)


@settings(deadline=None)
@given(trees)
def test_a_printed_formula_reads_back_as_the_same_tree(formula: Formula) -> None:
    assert parse_formula(str(formula)) == formula


@pytest.mark.parametrize(("text", "tree"), [
    ("p & q | r", Binary("|", Binary("&", P, Q), R)),
    ("p -> q -> r", Binary("->", P, Binary("->", Q, R))),
    ("NOT p AND q OR r", Binary("|", Binary("&", Unary("!", P), Q), R)),
    ("G p & q", Binary("&", Unary("G", P), Q)),
    ("G p > 3 + 1", Unary("G", Binary(">", P, Binary("+", Literal(3), Literal(1))))),
    ("p == q", Binary("=", P, Q)),
    ("p <> q", Binary("!=", P, Q)),
    ("p U q & r", Binary("&", Binary("U", P, Q), R)),
    ("p U[0s,5s) q", Binary("U", P, Q, Interval(0, 5 * NS_PER_S, True, False))),
    ("G(0s,5s] p", Unary("G", P, Interval(0, 5 * NS_PER_S, False, True))),
    ("F[1s,inf) p", Unary("F", P, Interval(NS_PER_S, None))),
    ("G (p)", Unary("G", P)),
    ("A[] p", Unary("AG", P)),
    ("E<> p", Unary("EF", P)),
    ("A<> p", Unary("AF", P)),
    ("E[] p", Unary("EG", P)),
    ("AG p --> q", Binary("-->", Unary("AG", P), Q)),
    ("rise(p) /* then */ & TRUE // end", Binary("&", Unary("rise", P), Literal(True))),
    ("-p - -q", Binary("-", Unary("negate", P), Unary("negate", Q))),
    ("p >= T#1s500ms", Binary(">=", P, Duration(1_500_000_000))),
    ("p = 'it$'s'", Binary("=", P, Literal("it's"))),
    ("`G` | p[1,2].x", Binary("|", TagRef("G"), TagRef("p[1,2].x"))),
    ("H & X > 3 & !G", Binary("&", Binary("&", TagRef("H"), Binary(">", TagRef("X"), Literal(3))),
                              Unary("!", TagRef("G")))),
    ("p[ -1, 2 ]", TagRef("p[-1,2]")),
    ("p[q + 1].x.y = 16#FF", Binary("=", Element("p", (Binary("+", Q, Literal(1)),), ".x.y"),
                                    Literal(255))),
    ("A[p U q] & E[p R[0s,1s] q]", Binary("&", Binary("AU", P, Q),
                                          Binary("ER", P, Q, Interval(0, NS_PER_S, True, True)))),
    ("A[ ] not p", Unary("AG", Unary("!", P))),
    ("A[] !deadlock", Unary("AG", Unary("!", Deadlock()))),
    ("[]<>p && [] q", Binary("&", Unary("G", Unary("F", P)), Unary("G", Q))),
    ("□◇(p ∧ ¬q → r)", Unary("G", Unary("F", Binary("->", Binary("&", P, Unary("!", Q)), R)))),
    ("p imply q xor r", Binary("->", P, Binary("xor", Q, R))),
    ("p = COLOR#RED", Binary("=", P, TagRef("COLOR#RED"))),
    ("abs(p - previous(q)) <= max(1, 2, 3) MOD 2", Binary(
        "<=", Call("abs", (Binary("-", P, Unary("previous", Q)),)),
        Binary("MOD", Call("max", (Literal(1), Literal(2), Literal(3))), Literal(2)))),
    ("p - ago(p, 5s) < 1", Binary("<", Binary("-", P, Call("ago", (P, Duration(5 * NS_PER_S)))),
                                  Literal(1))),
    ("rise & abs", Binary("&", TagRef("rise"), TagRef("abs"))),
    ("never & p", Binary("&", TagRef("never"), P)),
])
def test_operators_bind_as_the_table_says(text: str, tree: Formula) -> None:
    assert parse_formula(text) == tree


@pytest.mark.parametrize(("text", "message"), [
    ("p &", "1:4: M0001 found the end of the text, expected a tag"),
    ("(p", "1:3: M0001 found the end of the text, expected an operator or ')'"),
    ("p q", "1:3: M0001 found 'q', expected an operator or the end"),
    ("a = b = c", "1:7: M0001 found '=', expected parentheses"),
    ("G (& p)", "1:4: M0001 found '&', expected a tag"),
    ("p & U q", "TRUE, FALSE or '(' (a tag named U is written `U`)"),
    ("F[0,22] p", "1:5: M0001 found '22', expected a duration with its unit, such as 22s (write"),
    ("F[0s,inf] p", "1:9: M0001 found ']', expected ')' after inf"),
    ("F[5s,3s] p", "1:2: M0004 the interval [5s,3s] holds no instant"),
    ("F(5s,5s] p", "1:2: M0004 the interval (5s,5s] holds no instant"),
    ("Y[0s,1s] p", "1:2: M0005 the operator 'Y' takes no interval"),
    ("p ? q", "1:3: M0002 '?' is no character"),
    ("p > 1.0000000001s", "1:5: M0003 '1.0000000001s' is not a duration"),
    ("rise p", "1:6: M0001 found 'p', expected an operator or the end"),
    ("rise(p", "1:7: M0001 found the end of the text, expected an operator or ')'"),
    ("abs(p, q)", "1:6: M0001 found ',', expected an operator or ')'"),
    ("ago(p)", "1:6: M0001 found ')', expected ',' and operand 2 of ago"),
    ("p[i", "1:4: M0001 found the end of the text, expected an operator, ',' or ']'"),
    ("p causes q within 5", "1:19: M0001 found '5', expected a duration with its unit"),
    ("never both p or q", "1:14: M0001 found 'or', expected 'and', as in 'never both"),
    ("sequence p", "1:11: M0001 found the end of the text, expected ',' and the next of the list"),
    ("x stays within 1", "found the end of the text, expected 'to', as in"),
])
def test_a_mistake_is_told_with_its_place_and_what_was_expected(text: str, message: str) -> None:
    with pytest.raises(CompileError) as caught:
        parse_formula(text)
    assert message in str(caught.value)
    assert str(caught.value).startswith("<formula>:1:")


def test_a_file_holds_named_formulas_with_descriptions_and_comments() -> None:
    entries = parse_properties('''
        // tank B1
        overflow "B1 never overflows": G !plant.B1.overflow
        PS1: G (ready -> F[0s,5s]
                left)   /* over two lines */
    ''')
    assert [(e.name, e.description, str(e.formula)) for e in entries] == [
        ("overflow", "B1 never overflows", "G !plant.B1.overflow"),
        ("PS1", "", "G (ready -> F[0s,5s] left)")]


def test_an_empty_file_holds_no_property() -> None:
    assert parse_properties("// nothing yet\n") == []


def test_all_mistakes_of_a_file_are_told_in_one_go() -> None:
    with pytest.raises(CompileError) as caught:
        parse_properties('a: G )\nb "fine": p\nB: q\nc q\nd: F[1s] p\n')
    assert [(d.code, str(d.span)) for d in caught.value.diagnostics] == [
        ("M0001", "<properties>:1:6"), ("M0006", "<properties>:3:1"),
        ("M0001", "<properties>:4:1"), ("M0001", "<properties>:5:8")]


def test_a_file_that_is_not_utf_8_is_told_with_the_place_where_it_ends_to_be(tmp_path) -> None:
    path = tmp_path / "latin.prop"
    path.write_bytes(b"first: G a\nsecond: G gr\xfcn\n")
    with pytest.raises(CompileError) as caught:
        load_properties(path)
    assert f"{path}:2:13: M0007" in str(caught.value.diagnostics[0])


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path) -> None:
    path = tmp_path / "windows.prop"
    path.write_bytes(b"\xef\xbb\xbffirst: G a\n")
    assert [p.name for p in load_properties(path)] == ["first"]
