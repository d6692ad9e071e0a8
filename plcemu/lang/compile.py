"""The compiler, read aloud: text → tokens → trees → scopes → functions → program."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from importlib import resources
from pathlib import Path

from plcemu.base.areas import Address
from plcemu.base.collector import paused_collector
from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Source, Span
from plcemu.ir.check import check_function
from plcemu.ir.program import Function, Instance, Program
from plcemu.lang import syntax as s
from plcemu.lang.assemble import assemble
from plcemu.lang.checks import reachable, report_recursion, warn, warn_of_tasks
from plcemu.lang.connections import connected
from plcemu.lang.declarations import function_names, parse
from plcemu.lang.emitter import Emitter
from plcemu.lang.frames import Functions
from plcemu.lang.image import Image, addresses_in
from plcemu.lang.lexer import tokenize
from plcemu.lang.lower_il import InstructionList
from plcemu.lang.lower_sfc import Chart
from plcemu.lang.lower_sipn import SignalNet
from plcemu.lang.lower_st import Statements
from plcemu.lang.planning import Planned, Planner
from plcemu.lang.report import Report
from plcemu.lang.scope import Scope
from plcemu.lang.scopes import Declarations
from plcemu.lang.types import BOOL, Place

_LIBRARY: dict[str, tuple[str, tuple[str, ...]]] = {
    "timers.st": ("TIME", ("TIME", "LTIME")),
    "counters.st": ("INT", ("INT", "SINT", "DINT", "LINT", "USINT", "UINT", "UDINT", "ULINT")),
    "standard.st": ("", ()), "clock.st": ("", ()), "action_control.st": ("", ()),
}
"""The texts of the library; of each block of a text there is one variant `NAME_TYPE` for every type
that is listed, which stands in the place of the type before the list."""

_TYPED_BLOCK = re.compile(r"\b(?:CTU|CTD|CTUD|TP|TON|TOF)_(\w+)", re.IGNORECASE)


@paused_collector()
def compile_program(source: str | Path | Iterable[str | Path], *,
                    final_scan: bool = False, single_firing: bool = False) -> Program:
    """Compile a text, a file or several files into one program.

    Each PROGRAM becomes one instance of its name; all run in one task with the resource's cycle.

    Args:
        source: what to compile.
        final_scan: whether the actions of charts run once more in the scan in which they end
            (2.6.4.5, figures 14 and 15).
        single_firing: whether nets either take the inputs or fire once in a scan, so that each scan
            is one state of the net's state graph; else they fire until they are stable.

    Raises:
        CompileError: with every mistake found.
    """
    report = Report()
    sources = read_sources(source)
    tokens = [tokenize(each, report) for each in sources]
    names = function_names(token for each in tokens for token in each)
    units = [parse(each, report, names) for each in tokens]
    pous = [pou for unit in units for pou in unit.pous]
    report.stop_on_errors()
    addresses = addresses_in(t for each in tokens for t in each)
    library = _library(frozenset(of.upper() for each in sources
                                 for of in _TYPED_BLOCK.findall(each.text)))
    image, declarations, scopes = _declare(units, library, addresses, report, final_scan)
    if not any(pou.kind == "PROGRAM" for pou in pous):
        report.error("P0061", Span(sources[0], 0, 0), "there is no PROGRAM in this text")
    instances, tasks = Planner(units, scopes, declarations.globals, image, report).plan()
    plan = _plan(declarations, scopes, instances, image)
    functions = _lower_all(declarations, image, plan, report, single_firing)
    outer = _connect(units, instances, declarations, image, plan, report)
    functions.update((function.name, function) for function, _ in outer.values())
    report_recursion(functions, scopes, report)
    report.stop_on_errors()
    placed = tuple(Instance(each.name, outer[each.name][0].name if each.name in outer
                            else each.scope.pou.name.upper(), base)
                   for each, base in zip(instances, plan.bases, strict=True))
    writers = [*scopes, *(scope for _, scope in outer.values())]
    warn(writers, declarations.globals, report)
    warn_of_tasks(tasks, {i.name: i.function for i in placed}, writers, declarations.globals,
                  functions, report)
    for function in functions.values():
        check_function(function, functions)
    # The word is enough: no text can read a timer's ET without it.
    is_et_read = any(token.upper == "ET" for each in tokens for token in each)
    layout = assemble(declarations, instances, image, plan, addresses, is_et_read)
    used = reachable(functions, [i.function for i in placed])
    return Program({n: f for n, f in functions.items() if n in used}, layout, placed, tasks,
                   report.sorted())


def _declare(units: list[s.Unit], library: s.Unit, addresses: list[Address],
             report: Report, final_scan: bool) -> tuple[Image, Declarations, list[Scope]]:
    """Build the scopes of all POUs, and the image they need.

    How far an array with an address reaches is known after its declaration only: then everything is
    declared once more on an image that has room for it.
    """
    needed = list(addresses)
    for _ in range(2):
        image = Image(needed)
        declarations = Declarations([library, *units], image, report, final_scan)
        scopes = [scope for unit in units for pou in unit.pous
                  if (scope := declarations.scope(pou.name)) is not None]
        if not image.missing:
            break
        needed += image.missing
    return image, declarations, scopes


def _connect(units: list[s.Unit], instances: list[Planned], declarations: Declarations,
             image: Image, plan: Functions, report: Report) -> dict[str, tuple[Function, Scope]]:
    """Return what runs instances between their connections, by instance."""
    resources = {name.upper() for unit in units for c in unit.configurations
                 for name in (c.name, *c.resource_names)}
    made = {each.name: connected(each, resources, declarations.globals, image.offset, plan, report)
            for each in instances}
    return {name: each for name, each in made.items() if each is not None}


def _plan(declarations: Declarations, scopes: list[Scope], instances: list[Planned],
          image: Image) -> Functions:
    """Lay out memory: image, global variables, program instances, then frames of functions."""
    size = _rounded(image.size) + declarations.globals.type.size
    bases = []
    for each in instances:
        bases.append(size)
        size += each.scope.type.size
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
def _library(variants: frozenset[str] = frozenset()) -> s.Unit:
    """Return the standard function blocks, which are written in ST and compiled like user code.

    `variants` are the types of the typed ones that are wanted, such as DINT for CTU_DINT.
    """
    report = Report()
    pous: list[s.Pou] = []
    for name, (of, types) in _LIBRARY.items():
        text = resources.files("plcemu.lang").joinpath("library", name).read_text("utf-8")
        wanted = [each for each in types if each in variants]
        for variant in (text, *(_variant(text, of, each) for each in wanted)):
            pous += parse(tokenize(Source(f"library/{name}", variant), report), report).pous
    report.stop_on_errors()
    return s.Unit(tuple(pous), (), (), ())


def _variant(text: str, of: str, other: str) -> str:
    """Return a text of function blocks for another type, which their names get as an ending."""
    named = re.sub(r"(?m)^FUNCTION_BLOCK (\w+)", rf"FUNCTION_BLOCK \1_{other}", text)
    return re.sub(rf"\b{of}\b", other, named)


# ---------------------------------------------------------------- lowering


def _lower_all(declarations: Declarations, image: Image, plan: Functions, report: Report,
               single_firing: bool) -> dict[str, Function]:
    """Lower every POU that has a scope: the user's, and what of the library they use."""
    functions: dict[str, Function] = {}
    for scope in list(declarations.scopes.values()):
        _PouLowering(scope, image, plan, report, functions, single_firing).lower()
    return functions


class _PouLowering:
    """Lowers one POU into its functions: the main one, and one for each action and condition."""

    def __init__(self, scope: Scope, image: Image, plan: Functions, report: Report,
                 functions: dict[str, Function], single_firing: bool) -> None:
        self._single_firing = single_firing
        self._scope, self._image, self._plan, self._report = scope, image, plan, report
        self._functions = functions

    def lower(self) -> None:
        main = self._emitter(self._scope.pou.name.upper())
        body = self._scope.pou.body
        if self._scope.pou.kind == "FUNCTION":
            self._begin_function(main)
        self._find_edges(main)
        if isinstance(body, s.SfcBody):
            Chart(main, self._part).lower(body)
        elif isinstance(body, s.SipnBody):
            SignalNet(main, self._part, self._single_firing).lower(body)
        else:
            self._body(main, body)
        self._finish(main)

    def _begin_function(self, out: Emitter) -> None:
        """Give a function's own variables and its value their initial values, at every call."""
        for field in self._scope.type.fields.values():
            if field.section in ("VAR", "RESULT", "VAR_OUTPUT") and not field.constant:
                place = Place("this", field.offset, field.type)
                out.initialise(place, field, self._scope.pou.span)

    def _find_edges(self, out: Emitter) -> None:
        """Compare each input that tells its edges with what it was in the call before."""
        for written, last, now, variable in self._scope.edges:
            is_falling = variable.edge == "F_EDGE"
            for place, negated in ((written, is_falling), (last, True)):
                out.load(place, BOOL, variable.span)
                if negated:
                    out.emit("not.bool", None, variable.span)
            out.emit("and.bool", None, variable.span)
            out.store(now, BOOL, variable.span)
            out.load(written, BOOL, variable.span)
            if is_falling:
                out.emit("not.bool", None, variable.span)
            out.store(last, BOOL, variable.span)

    def _emitter(self, name: str, result: str = "") -> Emitter:
        out = Emitter(self._scope, self._image.offset, self._report, name, result, self._plan)
        for variable, _ in self._scope.temporaries.values():
            if variable.initial is not None and not isinstance(variable.initial,
                                                               s.ListValue | s.FieldValues):
                target = s.Name(variable.span, (variable.name,))
                Statements(out).assign(s.Assign(variable.span, target, variable.initial))
        self._begin_temporaries(out)
        return out

    def _begin_temporaries(self, out: Emitter) -> None:
        """Give VAR_TEMP arrays, structures and strings, which stand in the instance, values."""
        for field in self._scope.type.fields.values():
            if field.section == "VAR_TEMP":
                out.initialise(Place("this", field.offset, field.type), field, self._scope.pou.span)

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
