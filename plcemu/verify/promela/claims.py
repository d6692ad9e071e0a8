"""Formulas of LTL as SPIN knows them, and what they say of one run with a cycle.

SPIN's steps are those of the model; a formula must not count them, so X is left out, and so is
what speaks of the past or of durations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from plcemu.monitor.formula import Binary, Formula, Unary
from plcemu.verify.check import is_plain
from plcemu.verify.promela.code import NoPromela

ATOM = "atom_"
"""Stands before the number of a state formula in a written formula."""

_SAID = {"!": "!({0})", "G": "[] ({0})", "F": "<> ({0})", "&": "({0}) && ({1})",
         "|": "({0}) || ({1})", "->": "({0}) -> ({1})", "<->": "({0}) <-> ({1})",
         "xor": "!(({0}) <-> ({1}))", "U": "({0}) U ({1})",
         "W": "([] ({0})) || (({0}) U ({1}))", "R": "!((!({0})) U (!({1})))"}


_LASTING, _SOMETIME = "!begun || ({0})", "begun && ({0})"

_FROM_BEGIN = {"G": (_LASTING,), "F": (_SOMETIME,), "U": (_LASTING, _SOMETIME),
               "W": (_LASTING, _SOMETIME), "R": (_SOMETIME, _LASTING)}
"""What operands become so that the instants before the beginning make no difference."""


def ltl_of(formula: Formula, atoms: list[Formula], first: bool = True) -> str:
    """Return a formula in SPIN's words; its state formulas are put into `atoms`.

    It speaks of the instant at which `begun` becomes true, if it is the `first` one; instants
    before that do not count. That costs no operator, of which SPIN takes few.

    Raises:
        NoPromela: SPIN does not have an operator of it.
    """
    if is_plain(formula):
        if formula not in atoms:
            atoms.append(formula)
        atom = f"{ATOM}{atoms.index(formula)}"
        return f"(!begun) U (begun && {atom})" if first else atom
    if not isinstance(formula, (Unary, Binary)) or formula.op not in _SAID or formula.interval:
        raise NoPromela(f"SPIN's formulas have no durations, no past, and no X here: {formula}")
    said = [ltl_of(part, atoms, first and formula.op in _LOGIC) for part in _parts(formula)]
    if first and formula.op in _FROM_BEGIN:
        said = [f.format(part) for f, part in zip(_FROM_BEGIN[formula.op], said, strict=True)]
    return _SAID[formula.op].format(*said)


def holds_on(formula: Formula, atoms: Sequence[Formula], letters: Sequence[Sequence[bool]],
             back: int) -> bool:
    """Whether a run satisfies a formula.

    Args:
        formula: one that `ltl_of` takes.
        atoms: its state formulas.
        letters: which of them hold, for each instant of the run.
        back: the number of the instant that follows the last one.
    """
    return _values(formula, atoms, letters, back)[0]


def _parts(formula: Unary | Binary) -> tuple[Formula, ...]:
    return (formula.arg,) if isinstance(formula, Unary) else (formula.left, formula.right)


_LOGIC: dict[str, Callable[[bool, bool], bool]] = {
    "!": lambda p, _: not p, "&": lambda p, q: p and q, "|": lambda p, q: p or q,
    "->": lambda p, q: not p or q, "<->": lambda p, q: p == q, "xor": lambda p, q: p != q}

_UNTIL: dict[str, tuple[bool, Callable[[bool, bool, bool], bool]]] = {
    "F": (False, lambda p, _, after: p or after), "G": (True, lambda p, _, after: p and after),
    "U": (False, lambda p, q, after: q or (p and after)),
    "W": (True, lambda p, q, after: q or (p and after)),
    "R": (True, lambda p, q, after: q and (p or after))}
"""The value that a fixed point starts from, and the value at an instant by that at the next."""


def _values(formula: Formula, atoms: Sequence[Formula], letters: Sequence[Sequence[bool]],
            back: int) -> list[bool]:
    if formula in atoms:
        return [letter[atoms.index(formula)] for letter in letters]
    assert isinstance(formula, (Unary, Binary))
    parts = [_values(part, atoms, letters, back) for part in _parts(formula)]
    left, right = parts[0], parts[-1]
    if formula.op in _LOGIC:
        return [_LOGIC[formula.op](p, q) for p, q in zip(left, right, strict=True)]
    start, rule = _UNTIL[formula.op]
    values = [start] * len(letters)
    for _ in range(2):  # once from the end, and once more with what the cycle has come to
        for n in reversed(range(len(letters))):
            following = back if n == len(letters) - 1 else n + 1
            values[n] = rule(left[n], right[n], values[following])
    return values
