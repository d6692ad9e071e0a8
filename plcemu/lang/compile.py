"""The compiler, read aloud: text → tokens → trees → scopes → functions → program."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources
from pathlib import Path

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Source, Span
from plcemu.base.tags import Tag
from plcemu.base.types import ElementaryType
from plcemu.ir.check import check_function
from plcemu.ir.program import ClockCell, Function, Instance, Layout, Program, Slot, Task
from plcemu.lang import syntax as s
from plcemu.lang.declarations import parse
from plcemu.lang.emitter import Emitter
from plcemu.lang.lexer import tokenize
from plcemu.lang.lower_il import InstructionList
from plcemu.lang.lower_sfc import Chart
from plcemu.lang.lower_st import Statements
from plcemu.lang.report import Report
from plcemu.lang.scope import Declarations, Image, Scope, addresses_in
from plcemu.lang.types import BOOL, BlockType

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
    pous = [pou for each in tokens for pou in parse(each, report)]
    report.stop_on_errors()
    image = Image(addresses_in(t for each in tokens for t in each))
    declarations = Declarations([*pous, *_library()], image, report)
    scopes = [scope for pou in pous if (scope := declarations.scope(pou.name)) is not None]
    if not any(pou.kind == "PROGRAM" for pou in pous):
        report.error("P0061", Span(sources[0], 0, 0), "there is no PROGRAM in this text")
    report.stop_on_errors()
    functions = _lower_all(declarations, image, report)
    _warn_of_unused(scopes, report)
    report.stop_on_errors()
    for function in functions.values():
        check_function(function, functions)
    programs = [scope for scope in scopes if scope.pou.kind == "PROGRAM"]
    return _assemble(programs, image, functions, report.sorted())


def read_sources(source: str | Path | Iterable[str | Path]) -> list[Source]:
    """Return the texts: a Path is read, a str is the text itself.

    Raises:
        CompileError: a file cannot be read as UTF-8 text.
    """
    if isinstance(source, str):
        return [Source("<text>", source)]
    if isinstance(source, Path):
        return [_read(source)]
    return [made for each in source for made in read_sources(each)] or [Source("<text>", "")]


def _read(path: Path) -> Source:
    try:
        return Source(str(path), path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as problem:
        reason = problem.strerror if isinstance(problem, OSError) else "it is not UTF-8 text"
        span = Span(Source(str(path), ""), 0, 0)
        raise CompileError([Diagnostic("P0080", span, f"cannot read the file: {reason}")]) from None


def _library() -> list[s.Pou]:
    """Return the standard function blocks, which are written in ST and compiled like user code."""
    report, pous = Report(), []
    for name in _LIBRARY:
        text = resources.files("plcemu.lang").joinpath("library", name).read_text("utf-8")
        pous += parse(tokenize(Source(f"library/{name}", text), report), report)
    report.stop_on_errors()
    return pous


# ---------------------------------------------------------------- lowering


def _lower_all(declarations: Declarations, image: Image, report: Report) -> dict[str, Function]:
    """Lower every POU that has a scope: the user's, and what of the library they use."""
    functions: dict[str, Function] = {}
    for scope in list(declarations.scopes.values()):
        _PouLowering(scope, image, report, functions).lower()
    return functions


class _PouLowering:
    """Lowers one POU into its functions: the main one, and one for each action and condition."""

    def __init__(self, scope: Scope, image: Image, report: Report,
                 functions: dict[str, Function]) -> None:
        self._scope, self._image, self._report = scope, image, report
        self._functions = functions

    def lower(self) -> None:
        main = self._emitter(self._scope.pou.name.upper())
        body = self._scope.pou.body
        if isinstance(body, s.SfcBody):
            Chart(main, self._part).lower(body)
        else:
            self._body(main, body)
        self._finish(main)

    def _emitter(self, name: str, result: str = "") -> Emitter:
        out = Emitter(self._scope, self._image.offset, self._report, name, result)
        for variable, _ in self._scope.temporaries.values():
            if variable.initial is not None:
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


# ---------------------------------------------------------------- assembling


def _assemble(programs: list[Scope], image: Image, functions: dict[str, Function],
              warnings: list[Diagnostic]) -> Program:
    """Lay out memory (the image, then the instances) and put everything together."""
    size = -(-image.size // 8) * 8
    instances = []
    for scope in programs:
        instances.append(Instance(scope.pou.name, scope.pou.name.upper(), size))
        size += scope.type.size
    initial, slots, clocks = bytearray(size), [], []
    for scope, instance in zip(programs, instances, strict=True):
        slots += _located_slots(scope, initial)
        slots += _instance_slots(scope.type, instance, initial)
        clocks += [ClockCell(offset, _is_observed(holder))
                   for offset, holder in scope.type.clocks(instance.base)]
    layout = Layout(bytes(initial), tuple(slots), tuple(image.extents), tuple(clocks))
    task = Task("main", programs=tuple(i.name for i in instances))
    used = _reachable(functions, [i.function for i in instances])
    return Program({n: f for n, f in functions.items() if n in used}, layout, tuple(instances),
                   (task,), warnings)


def _located_slots(scope: Scope, initial: bytearray) -> list[Slot]:
    slots = []
    for each in scope.located:
        if each.initial is not None:
            _put(initial, each.offset, each.type, each.initial)
        address = str(each.address)
        name = f"{scope.pou.name}.{each.name}" if not each.name.startswith("%") else address
        slots.append(Slot(Tag(name, each.type.name, address=address), each.offset))
    return slots


def _instance_slots(block: BlockType, instance: Instance, initial: bytearray) -> list[Slot]:
    slots = []
    for name, offset, each in block.walk(f"{instance.name}.", instance.base):
        assert isinstance(each.type, ElementaryType)
        if each.initial is not None:
            _put(initial, offset, each.type, each.initial)
        if "__" not in name:
            slots.append(Slot(Tag(name, each.type.name, "ns" if each.type.kind == "time" else ""),
                              offset))
    return slots


def _put(initial: bytearray, offset: int, of: ElementaryType, value: object) -> None:
    assert isinstance(value, bool | int | float)
    initial[offset:offset + of.size] = of.pack(value)


def _is_observed(holder: BlockType) -> bool:
    return holder.kind == "CLOCK" or holder.name.endswith("observed")


def _reachable(functions: dict[str, Function], roots: list[str]) -> set[str]:
    found: set[str] = set()
    pending = list(roots)
    while pending:
        name = pending.pop()
        if name not in found:
            found.add(name)
            pending += [i.arg for i in functions[name].code if i.op == "call"]
    return found

