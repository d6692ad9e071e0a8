"""Signal Interpreted Petri Nets written as Instruction List, for any PLC that takes IL.

The rest of a text stays as it is: only the bodies that are nets are replaced. The names of places,
transitions and flags stay, so that the same tags tell the same of both programs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic
from plcemu.lang import syntax as s
from plcemu.lang.compile import compile_program, read_sources
from plcemu.lang.declarations import parse
from plcemu.lang.lexer import tokenize
from plcemu.lang.lower_sipn import ROUNDS, given_by_places
from plcemu.lang.report import Report
from plcemu.lang.sipn import FLAGS
from plcemu.lang.sipn_net import Net

Lines = Iterator[str]


def export_il(source: str | Path | Iterable[str | Path], *, single_firing: bool = False) -> str:
    """Return the texts, one after another, with every net as Instruction List.

    Args:
        source: text, file or files, which are compiled first.
        single_firing: as in `compile_program`.

    Raises:
        CompileError: the program is wrong, or a condition holds what this export cannot write.
    """
    compile_program(source, single_firing=single_firing)
    texts = []
    for each in read_sources(source):
        report = Report()
        text = each.text
        for pou in reversed(parse(tokenize(each, report), report).pous):
            if isinstance(pou.body, s.SipnBody):
                span = pou.body.span
                text = text[:span.start] + "\n".join(_Writer(pou, pou.body).lines(single_firing)) \
                    + text[span.end:]
        texts.append(text)
    return "\n".join(texts)


class _Writer:
    """Writes one net."""

    def __init__(self, pou: s.Pou, body: s.SipnBody) -> None:
        self._body, self._net = body, Net(body)
        taken = {v.name.upper() for v in pou.variables} | {f.upper() for f in FLAGS}
        taken |= {p.name.upper() for p in body.places} | {t.name.upper() for t in body.transitions}
        made = (f"{word}_{t.name}" for t in body.transitions for word in ("holds", "can", "fires"))
        self._names: dict[str, str] = {}
        for wanted in ("rounds", "take", "look", "again", *made):
            free = wanted
            while free.upper() in taken:
                free += "_x"
            taken.add(free.upper())
            self._names[wanted] = free

    def _of(self, word: str, transition: s.NetTransition) -> str:
        return self._names[f"{word}_{transition.name}"]

    def lines(self, single: bool) -> Lines:
        """Yield the declarations and the body."""
        yield "VAR (* places *)"
        for place in self._body.places:
            yield f"  {place.name} : BOOL{' := TRUE' if place.initial else ''};"
        yield "END_VAR"
        yield "VAR (* flags, transitions, and whether their conditions hold *)"
        for flag in FLAGS:
            yield f"  {flag} : BOOL{' := TRUE' if flag == 'eoc' else ''};"
        for each in self._body.transitions:
            yield f"  {each.name}, {self._of('holds', each)} : BOOL;"
        yield "END_VAR"
        yield "VAR_TEMP"
        for each in self._body.transitions:
            able = "" if single else f"{self._of('can', each)}, "
            yield f"  {able}{self._of('fires', each)} : BOOL;"
        if not single:
            yield f"  {self._names['rounds']} : INT;"
        yield "END_VAR"
        yield from self._single() if single else self._rounds()
        yield "(* outputs of a stable marking *)"
        yield from ("  LD eoc", "  RETCN")
        yield from self._outputs()

    def _rounds(self) -> Lines:
        rounds, again, look = (self._names[n] for n in ("rounds", "again", "look"))
        yield from ("(* in a stable marking the inputs are taken *)", "  LD eoc", f"  JMPCN {look}")
        yield from self._take()
        yield from (f"{look}:", "  LD FALSE", "  ST conflict")
        yield from (f"  ST {t.name}" for t in self._body.transitions)
        yield from ("  LD 0", f"  ST {rounds}")
        yield f"(* round after round, {ROUNDS} at most, until the marking is stable *)"
        yield f"{again}:"
        for each in self._body.transitions:
            yield from self._able(each, self._of("can", each))
            yield from (f"  OR {each.name}", f"  ST {each.name}")
        able = [self._of("can", t) for t in self._body.transitions]
        yield from self._choose(able)
        yield from self._collide(able, "  LD conflict")
        yield from self._stable(able)
        yield from self._fire()
        yield from (f"  LD {rounds}", "  ADD 1", f"  ST {rounds}", f"  GE {ROUNDS}", "  OR eoc",
                    f"  JMPCN {again}")

    def _single(self) -> Lines:
        take, look = self._names["take"], self._names["look"]
        able = [t.name for t in self._body.transitions]
        yield from ("(* fire once, or take the inputs in a stable marking *)", "  LD eoc",
                    f"  JMPC {take}")
        yield from self._choose(able)
        yield from self._fire()
        yield from (f"  JMP {look}", f"{take}:")
        yield from self._take()
        yield f"{look}:"
        for each in self._body.transitions:
            yield from self._able(each, each.name)
        yield from self._choose(able)
        yield from self._collide(able, "  LD FALSE")
        yield from self._stable(able)

    def _take(self) -> Lines:
        for each in self._body.transitions:
            yield from _load(each.condition)
            yield f"  ST {self._of('holds', each)}"

    def _able(self, transition: s.NetTransition, result: str) -> Lines:
        yield f"  LD {self._of('holds', transition)}"
        yield from (f"  AND {each}" for each in transition.sources)
        sources = {each.head.upper() for each in transition.sources}
        yield from (f"  ANDN {each}" for each in transition.targets
                    if each.head.upper() not in sources)
        yield f"  ST {result}"

    def _choose(self, able: list[str]) -> Lines:
        """Of transitions that share a place, let the first in the text fire."""
        for n, each in enumerate(self._body.transitions):
            yield f"  LD {able[n]}"
            yield from (f"  ANDN {self._of('fires', self._body.transitions[m])}"
                        for m in self._net.rivals(n))
            yield f"  ST {self._of('fires', each)}"

    def _collide(self, able: list[str], begin: str) -> Lines:
        yield begin
        for each, name in zip(self._body.transitions, able, strict=True):
            yield from ("  OR(", f"  LD {name}", f"  ANDN {self._of('fires', each)}", "  )")
        yield "  ST conflict"

    @staticmethod
    def _stable(able: list[str]) -> Lines:
        yield from _joined(able)
        yield "  STN eoc"

    def _fire(self) -> Lines:
        for each in self._body.transitions:
            before = {p.head.upper() for p in each.sources}
            after = {p.head.upper() for p in each.targets}
            yield f"  LD {self._of('fires', each)}"
            yield from (f"  R {p}" for p in each.sources if p.head.upper() not in after)
            yield from (f"  S {p}" for p in each.targets if p.head.upper() not in before)

    def _outputs(self) -> Lines:
        given = given_by_places(self._body)
        for target, ones, zeros in given:
            output = _text(target)
            yield from (*_joined(ones), f"  S {output}", *_joined(zeros), f"  R {output}")
        yield "(* outputs that no marked place gives a value, or that two give different ones *)"
        yield from ("  LD FALSE", "  ST undefined", "  ST contradictory")
        for _, ones, zeros in given:
            yield from (*_joined([*ones, *zeros]), "  NOT", "  OR undefined", "  ST undefined")
            yield from (*_joined(ones), "  AND(", *_joined(zeros), "  )", "  OR contradictory",
                        "  ST contradictory")


def _joined(names: list[str]) -> Lines:
    yield f"  LD {names[0] if names else 'FALSE'}"
    yield from (f"  OR {each}" for each in names[1:])


# ---------------------------------------------------------------- conditions

_SIMPLE = (s.Name, s.Direct, s.Literal)
_LOGIC = ("AND", "OR", "XOR")


def _text(expr: s.Expr) -> str:
    return expr.span.source.text[expr.span.start:expr.span.end]


def _load(expr: s.Expr) -> Lines:
    """Yield the instructions that leave an expression's value as the current result."""
    if isinstance(expr, _SIMPLE):
        yield f"  LD {_text(expr)}"
    elif isinstance(expr, s.Unary) and expr.op == "NOT" and isinstance(expr.operand, s.Name):
        yield f"  LDN {_text(expr.operand)}"
    elif isinstance(expr, s.Unary):
        yield from _load(expr.operand)
        yield "  NOT" if expr.op == "NOT" else "  MUL -1"
    elif isinstance(expr, s.Binary):
        yield from _load(expr.left)
        yield from _with(expr.op, expr.right)
    elif isinstance(expr, s.Call) and expr.arguments \
            and all(not a.name and isinstance(a.value, _SIMPLE) for a in expr.arguments[1:]):
        yield from _load(expr.arguments[0].value)
        rest = ", ".join(_text(a.value) for a in expr.arguments[1:])
        yield f"  {expr.name} {rest}".rstrip()
    else:
        raise CompileError([Diagnostic(
            "P0090", expr.span, "this call cannot be written as IL; let a statement of another POU "
            "give its value to a variable")])


def _with(op: str, operand: s.Expr) -> Lines:
    """Yield the instructions that combine the current result with an operand."""
    inner = operand
    inverted = op in _LOGIC and isinstance(operand, s.Unary) and operand.op == "NOT"
    if inverted and isinstance(operand, s.Unary):
        inner = operand.operand
    if isinstance(inner, _SIMPLE):
        yield f"  {op}{'N' if inverted else ''} {_text(inner)}"
    else:
        yield from (f"  {op}(", *_load(operand), "  )")
