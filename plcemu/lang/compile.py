"""The compiler, read aloud: text → tokens → trees → scopes → functions → program."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib import resources
from pathlib import Path

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Source, Span
from plcemu.ir.check import check_function
from plcemu.ir.program import Function, Instance, Program
from plcemu.lang import syntax as s
from plcemu.lang.assemble import assemble, plan_instances
from plcemu.lang.declarations import parse
from plcemu.lang.emitter import Emitter
from plcemu.lang.frames import Functions
from plcemu.lang.lexer import tokenize
from plcemu.lang.lower_il import InstructionList
from plcemu.lang.lower_sfc import Chart
from plcemu.lang.lower_st import Statements
from plcemu.lang.report import Report
from plcemu.lang.image import Image, addresses_in
from plcemu.lang.scope import Declarations, Scope
from plcemu.lang.types import BOOL, Place

_LIBRARY = ("timers.st", "standard.st", "action_control.st")


def compile_program(source: str | Path | Iterable[str | Path]) -> Program:
    """Compile a text, a file or several files into one program.

    Each PROGRAM becomes one instance of its name; all run in one task with the resource's cycle.

    Raises:
        CompileError: with every mistake found.
    """
    report = Report()
    sources = read_sources(source)
    tokens = [tokenize(each, report) for each in sources]
    units = [parse(each, report) for each in tokens]
    pous = [pou for unit in units for pou in unit.pous]
    report.stop_on_errors()
    addresses = addresses_in(t for each in tokens for t in each)
    image = Image(addresses)
    declarations = Declarations([_library(), *units], image, report)
    scopes = [scope for pou in pous if (scope := declarations.scope(pou.name)) is not None]
    if not any(pou.kind == "PROGRAM" for pou in pous):
        report.error("P0061", Span(sources[0], 0, 0), "there is no PROGRAM in this text")
    instances, tasks = plan_instances(units, scopes, report)
    plan = _plan(declarations, scopes, instances, image)
    functions = _lower_all(declarations, image, plan, report)
    report.stop_on_errors()
    _warn_of_unused(scopes, report)
    for function in functions.values():
        check_function(function, functions)
    layout = assemble(declarations, instances, image, plan, addresses)
    placed = tuple(Instance(name, scope.pou.name.upper(), base)
                   for (name, scope), base in zip(instances, plan.bases, strict=True))
    used = _reachable(functions, [i.function for i in placed])
    return Program({n: f for n, f in functions.items() if n in used}, layout, placed, tasks,
                   report.sorted())


def _plan(declarations: Declarations, scopes: list[Scope], instances: list[tuple[str, Scope]],
          image: Image) -> Functions:
    """Lay out memory: image, global variables, program instances, then frames of functions."""
    size = _rounded(image.size) + declarations.globals.type.size
    bases = []
    for _, scope in instances:
        bases.append(size)
        size += scope.type.size
    blocks = [x.type for x in declarations.scopes.values() if x.pou.kind == "FUNCTION"]
    return Functions(blocks, size, bases)


def _rounded(size: int) -> int:
    return -(-size // 8) * 8


def read_sources(source: str | Path | Iterable[str | Path]) -> list[Source]:
    """Return the texts: a Path is read, a str is the text itself; a byte order mark is dropped.

    Raises:
        CompileError: a file cannot be read as UTF-8 text.
    """
    if isinstance(source, str):
        return [Source("<text>", source.removeprefix("\ufeff"))]
    if isinstance(source, Path):
        return [_read(source)]
    return [made for each in source for made in read_sources(each)] or [Source("<text>", "")]


def _read(path: Path) -> Source:
    try:
        return Source(str(path), path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as problem:
        before = Source(str(path), problem.object[:problem.start].decode("utf-8-sig"))
        reason = "it is not UTF-8 text from here on"
    except (OSError, ValueError) as problem:
        before = Source(str(path), "")
        reason = problem.strerror if isinstance(problem, OSError) and problem.strerror \
            else str(problem)
    span = Span(before, len(before.text), len(before.text))
    raise CompileError([Diagnostic("P0080", span, f"cannot read the file: {reason}")])


@cache
def _library() -> s.Unit:
    """Return the standard function blocks, which are written in ST and compiled like user code."""
    report = Report()
    pous: list[s.Pou] = []
    for name in _LIBRARY:
        text = resources.files("plcemu.lang").joinpath("library", name).read_text("utf-8")
        pous += parse(tokenize(Source(f"library/{name}", text), report), report).pous
    report.stop_on_errors()
    return s.Unit(tuple(pous), (), (), ())


# ---------------------------------------------------------------- lowering


def _lower_all(declarations: Declarations, image: Image, plan: Functions,
               report: Report) -> dict[str, Function]:
    """Lower every POU that has a scope: the user's, and what of the library they use."""
    functions: dict[str, Function] = {}
    for scope in list(declarations.scopes.values()):
        _PouLowering(scope, image, plan, report, functions).lower()
    return functions


class _PouLowering:
    """Lowers one POU into its functions: the main one, and one for each action and condition."""

    def __init__(self, scope: Scope, image: Image, plan: Functions, report: Report,
                 functions: dict[str, Function]) -> None:
        self._scope, self._image, self._plan, self._report = scope, image, plan, report
        self._functions = functions

    def lower(self) -> None:
        main = self._emitter(self._scope.pou.name.upper())
        body = self._scope.pou.body
        if self._scope.pou.kind == "FUNCTION":
            self._begin_function(main)
        if isinstance(body, s.SfcBody):
            Chart(main, self._part).lower(body)
        else:
            self._body(main, body)
        self._finish(main)

    def _begin_function(self, out: Emitter) -> None:
        """Give a function's own variables and its value their initial values, at every call."""
        for field in self._scope.type.fields.values():
            if field.section in ("VAR", "RESULT", "VAR_OUTPUT") and not field.constant:
                place = Place("this", field.offset, field.type)
                out.initialise(place, field, self._scope.pou.span)

    def _emitter(self, name: str, result: str = "") -> Emitter:
        out = Emitter(self._scope, self._image.offset, self._report, name, result, self._plan)
        for variable, _ in self._scope.temporaries.values():
            if variable.initial is not None and not isinstance(variable.initial,
                                                               s.ListValue | s.FieldValues):
                target = s.Name(variable.span, (variable.name,))
                Statements(out).assign(s.Assign(variable.span, target, variable.initial))
        return out

    def _body(self, out: Emitter, body: s.IlBody | s.StBody) -> None:
        if isinstance(body, s.IlBody):
            InstructionList(out).lower(body)
        else:
            Statements(out).lower(body.statements)

    def _part(self, name: str, body: s.IlBody | s.StBody | s.Expr, result: str) -> str:
        """Make a function from an action's body or a transition's condition; return its name."""
        full = f"{self._scope.pou.name}.{name}".upper()
        while full in self._functions:
            full += "'"
        out = self._emitter(full, result)
        if isinstance(body, s.IlBody | s.StBody):
            self._body(out, body)
        else:
            Statements(out).expressions.emit(body, BOOL)
        self._finish(out)
        return full

    def _finish(self, out: Emitter) -> None:
        out.emit("ret", None, self._scope.pou.span)
        self._functions[out.name] = out.function()


def _warn_of_unused(scopes: list[Scope], report: Report) -> None:
    for scope in scopes:
        for variable in scope.unused.values():
            report.warning("P0070", variable.span, f"variable {variable.name!r} is never used")


def _reachable(functions: dict[str, Function], roots: list[str]) -> set[str]:
    found: set[str] = set()
    pending = list(roots)
    while pending:
        name = pending.pop()
        if name not in found:
            found.add(name)
            pending += [i.arg for i in functions[name].code if i.op == "call"]
    return found

