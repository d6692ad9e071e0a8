"""What charts and nets build statements from, and how to look through trees."""

from __future__ import annotations

from collections.abc import Iterator

from plcemu.base.spans import Span
from plcemu.lang import syntax as s


def named(span: Span, *parts: str) -> s.Name:
    """Return a variable, perhaps with fields."""
    return s.Name(span, parts)


def boolean(span: Span, value: bool) -> s.Expr:
    """Return TRUE or FALSE."""
    return s.Literal(span, "bool", value)


def number(span: Span, value: int) -> s.Expr:
    """Return a whole number."""
    return s.Literal(span, "int", value)


def negated(operand: s.Expr) -> s.Expr:
    """Return NOT operand."""
    return s.Unary(operand.span, "NOT", operand)


def any_of(terms: list[s.Expr], span: Span) -> s.Expr:
    """Return the terms joined by OR; FALSE if there are none."""
    return _joined("OR", terms, span) if terms else boolean(span, False)


def all_of(terms: list[s.Expr], span: Span) -> s.Expr:
    """Return the terms joined by AND; TRUE if there are none."""
    return _joined("AND", terms, span) if terms else boolean(span, True)


def _joined(op: str, terms: list[s.Expr], span: Span) -> s.Expr:
    """Join by halves, so that thousands of terms do not nest thousands of levels deep."""
    if len(terms) == 1:
        return terms[0]
    half = (len(terms) + 1) // 2
    return s.Binary(span, op, _joined(op, terms[:half], span), _joined(op, terms[half:], span))


def assign(span: Span, target: str, value: s.Expr) -> s.Statement:
    """Return `target := value`."""
    return s.Assign(span, named(span, target), value)


def names_in(tree: object) -> Iterator[s.Name]:
    """Yield every variable's name in a tree, those in subscripts and arguments too."""
    pending = [tree]
    while pending:
        node = pending.pop()
        if isinstance(node, s.Name):
            yield node
            pending.extend(part for part in node.parts if isinstance(part, tuple))
        elif isinstance(node, tuple):
            pending.extend(node)
        elif hasattr(node, "__dataclass_fields__") and not isinstance(node, Span):
            pending.extend(getattr(node, field) for field in node.__dataclass_fields__)
