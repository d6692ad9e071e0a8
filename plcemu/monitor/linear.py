"""What of the language can be judged on one run, and how it is said in few operators.

Branching forms are taken where they mean the same on the one run that is seen: "on all runs" may
stand where the formula demands, "on some run" only where it forbids. `p --> q` is
`G (p -> F q)`. The rest speaks of runs that nobody sees, and is refused with that reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from plcemu.base.spans import Diagnostic
from plcemu.monitor.codes import diagnostic
from plcemu.monitor.formula import (
    FALSE,
    OPERATORS,
    TRUE,
    Binary,
    Deadlock,
    Formula,
    Kind,
    Literal,
    Unary,
    children,
    is_state,
    walk,
)

_ON_ALL_RUNS = {"AG": "G", "AF": "F", "AX": "X", "AU": "U", "AW": "W", "AR": "R"}
_ON_SOME_RUN = {"EG": "G", "EF": "F", "EX": "X", "EU": "U", "EW": "W", "ER": "R"}
_FLIPPED, _BOTH = frozenset({"!"}), frozenset({"<->", "xor"})
_NEXT_SCAN = ("the instant of the next scan is not known beforehand; after X only tags, numbers, "
              "! & | and rise, fall, changed may stand, or give a time, as in F[0s,20ms] q")


def on_one_run(formula: Formula, diagnostics: list[Diagnostic]) -> Formula:
    """Return the formula without branching operators; what cannot be judged is reported."""
    return _folded(_Rewriter(diagnostics).rewrite(formula, demanded=True, forbidden=False))


class _Rewriter:
    """Walks down a formula, keeping whether its parts are demanded, forbidden or both."""

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        self.diagnostics = diagnostics

    def rewrite(self, formula: Formula, demanded: bool, forbidden: bool) -> Formula:
        if isinstance(formula, Deadlock):
            self.report("M0020", formula, "whether any step can follow is a question about all "
                                          "steps that could; prove it with 'plcemu verify'")
        if not isinstance(formula, (Unary, Binary)):
            return formula
        kind = OPERATORS[formula.op].kind
        if kind in (Kind.COMPARISON, Kind.ARITHMETIC, Kind.PULSE, Kind.EARLIER):
            self.check_timeless(formula)
            return formula
        op = formula.op
        if kind is Kind.BRANCHING and op != "-->":
            op = self.branching(formula, demanded, forbidden)
        if isinstance(formula, Binary):
            return self.binary(replace(formula, op=op), demanded, forbidden)
        if op == "X" and not is_state(formula.arg):
            self.report("M0021", formula, _NEXT_SCAN)
        if op in _FLIPPED:
            demanded, forbidden = forbidden, demanded
        return replace(formula, op=op, arg=self.rewrite(formula.arg, demanded, forbidden))

    def binary(self, formula: Binary, demanded: bool, forbidden: bool) -> Formula:
        if formula.op in _BOTH:
            demanded = forbidden = True
        flips = formula.op in ("->", "-->")
        left = self.rewrite(formula.left, *((forbidden, demanded) if flips
                                            else (demanded, forbidden)))
        right = self.rewrite(formula.right, demanded, forbidden)
        if formula.op == "xor":
            return Unary("!", replace(formula, op="<->", left=left, right=right), None,
                         formula.span)
        if formula.op != "-->":
            return replace(formula, left=left, right=right)
        if forbidden:
            self.report("M0020", formula, "p --> q says that q follows p on all runs; here it is "
                                          "demanded that on some run it does not")
        response = Binary("->", left, Unary("F", right, None, right.span), None, formula.span)
        return Unary("G", response, None, formula.span)

    def branching(self, formula: Unary | Binary, demanded: bool, forbidden: bool) -> str:
        """Return the operator that means the same on one run."""
        table = {} if demanded and forbidden else _ON_ALL_RUNS if demanded else _ON_SOME_RUN
        if formula.op in table:
            return table[formula.op]
        what = "all runs" if formula.op in _ON_ALL_RUNS else "some run"
        self.report("M0020", formula,
                    f"{formula.op} on {what} cannot be judged here from the one run that a "
                    "monitor sees; prove it with 'plcemu verify'")
        return (_ON_ALL_RUNS | _ON_SOME_RUN)[formula.op]

    def check_timeless(self, formula: Formula) -> None:
        """Report temporal operators under a comparison, arithmetic, a function or a pulse."""
        pulse = isinstance(formula, Unary) and OPERATORS[formula.op].kind in (
            Kind.PULSE, Kind.EARLIER)
        for part in children(formula):
            if not is_state(part) or (pulse and looks_back(part)):
                self.report("M0022", part, "only tags, numbers and ! & | may stand there")
            else:
                self.check_timeless(part)

    def report(self, code: str, formula: Formula, hint: str) -> None:
        name = getattr(formula, "op", str(formula))
        self.diagnostics.append(diagnostic(code, formula.span, hint, found=repr(name)))


def _folded(formula: Formula) -> Formula:
    """Return the formula with TRUE and FALSE worked out of its connectives."""
    if isinstance(formula, Unary):
        arg = _folded(formula.arg)
        constant = formula.op == "!" and isinstance(arg, Literal)
        return FALSE if constant and arg == TRUE else TRUE if constant else replace(
            formula, arg=arg)
    if isinstance(formula, Binary) and formula.op in _UNITS:
        left, right = _folded(formula.left), _folded(formula.right)
        for one, other, units in ((left, right, _UNITS[formula.op][0]),
                                  (right, left, _UNITS[formula.op][1])):
            if isinstance(one, Literal):
                return units[bool(one.value)](other)
        return replace(formula, left=left, right=right)
    if isinstance(formula, Binary):
        return replace(formula, left=_folded(formula.left), right=_folded(formula.right))
    return formula


def _negated(formula: Formula) -> Formula:
    return _folded(Unary("!", formula, None, formula.span))


def _same(formula: Formula) -> Formula:
    return formula


def _true(_: Formula) -> Formula:
    return TRUE


def _false(_: Formula) -> Formula:
    return FALSE


_Units = tuple[Callable[[Formula], Formula], Callable[[Formula], Formula]]
# What remains of the other operand if the left (first pair) or the right one is FALSE or TRUE.
_UNITS: dict[str, tuple[_Units, _Units]] = {
    "&": ((_false, _same), (_false, _same)),
    "|": ((_same, _true), (_same, _true)),
    "->": ((_true, _same), (_negated, _true)),
    "<->": ((_negated, _same), (_negated, _same)),
}


def looks_back(formula: Formula) -> bool:
    """Tell whether rise, fall, changed or previous occur, so that it may hold for one instant."""
    return any(isinstance(part, Unary) and OPERATORS[part.op].kind in (Kind.PULSE, Kind.EARLIER)
               for part in walk(formula))
