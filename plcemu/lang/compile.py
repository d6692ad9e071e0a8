"""The compiler, read aloud: text → tokens → trees → scopes → functions → program."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib import resources
from pathlib import Path

from plcemu.base.areas import Address
from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic, Source, Span
from plcemu.base.tags import Tag
from plcemu.base.types import ElementaryType
from plcemu.ir.check import check_function
from plcemu.ir.program import ClockCell, Function, Instance, Layout, Program, Slot, Task
from plcemu.lang import syntax as s
from plcemu.lang.declarations import parse
from plcemu.lang.emitter import Emitter
from plcemu.lang.frames import Functions
from plcemu.lang.lexer import tokenize
from plcemu.lang.lower_il import InstructionList
from plcemu.lang.lower_sfc import Chart
from plcemu.lang.lower_st import Statements
from plcemu.lang.report import Report
from plcemu.lang.scope import Declarations, Image, Scope, addresses_in
from plcemu.lang.types import BOOL, TYPE_OF_SIZE, BlockType, Place

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
    addresses = addresses_in(t for each in tokens for t in each)
    image = Image(addresses)
    declarations = Declarations([*_library(), *pous], image, report)
    scopes = [scope for pou in pous if (scope := declarations.scope(pou.name)) is not None]
    if not any(pou.kind == "PROGRAM" for pou in pous):
        report.error("P0061", Span(sources[0], 0, 0), "there is no PROGRAM in this text")
    plan = _plan(scopes, image)
    functions = _lower_all(declarations, image, plan, report)
    report.stop_on_errors()
    _warn_of_unused(scopes, report)
    for function in functions.values():
        check_function(function, functions)
    programs = [scope for scope in scopes if scope.pou.kind == "PROGRAM"]
    return _assemble(programs, image, plan, addresses, functions, report.sorted())


def _plan(scopes: list[Scope], image: Image) -> Functions:
    """Lay out memory: the image, the program instances, then the frames of functions."""
    size = _rounded(image.size)
    for scope in scopes:
        if scope.pou.kind == "PROGRAM":
            size += scope.type.size
    return Functions((x.type for x in scopes if x.pou.kind == "FUNCTION"), size)


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
def _library() -> tuple[s.Pou, ...]:
    """Return the standard function blocks, which are written in ST and compiled like user code."""
    report = Report()
    pous: list[s.Pou] = []
    for name in _LIBRARY:
        text = resources.files("plcemu.lang").joinpath("library", name).read_text("utf-8")
        pous += parse(tokenize(Source(f"library/{name}", text), report), report)
    report.stop_on_errors()
    return tuple(pous)


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
                assert isinstance(field.type, ElementaryType)
                value = field.initial if field.initial is not None \
                    else field.type.unpack(bytes(field.type.size))
                span = self._scope.pou.span
                out.emit("const", (field.type.machine, value), span)
                out.store(Place("this", field.offset, field.type), field.type, span)

    def _emitter(self, name: str, result: str = "") -> Emitter:
        out = Emitter(self._scope, self._image.offset, self._report, name, result, self._plan)
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


def _assemble(programs: list[Scope], image: Image, plan: Functions, addresses: list[Address],
              functions: dict[str, Function], warnings: list[Diagnostic]) -> Program:
    """Lay out memory (the image, then the instances) and put everything together."""
    size = _rounded(image.size)
    instances = []
    for scope in programs:
        instances.append(Instance(scope.pou.name, scope.pou.name.upper(), size))
        size += scope.type.size
    initial = bytearray(plan.end)
    slots: list[Slot] = []
    clocks: list[ClockCell] = []
    for scope, instance in zip(programs, instances, strict=True):
        slots += _located_slots(scope, initial)
        slots += _instance_slots(scope.type, instance, initial)
        clocks += [ClockCell(offset, _is_observed(holder))
                   for offset, holder in scope.type.clocks(instance.base)]
    slots += _direct_slots(programs, addresses, image, {slot.tag.address for slot in slots})
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
        if not each.name.startswith("%"):
            name = f"{scope.pou.name}.{each.name}"
            slots.append(Slot(Tag(name, each.type.name, address=str(each.address)), each.offset))
    return slots


def _direct_slots(programs: list[Scope], addresses: list[Address], image: Image,
                  named: set[str]) -> list[Slot]:
    """Return a slot for every address that the program uses and no named variable has."""
    types = {str(each.address): each.type for scope in programs for each in scope.located}
    unnamed = sorted(set(addresses), key=lambda a: (a.area, a.index))
    return [Slot(Tag(str(a), types.get(str(a), TYPE_OF_SIZE[a.area[1]]).name, address=str(a)),
                 image.offset(a)) for a in unnamed if str(a) not in named]


def _instance_slots(block: BlockType, instance: Instance, initial: bytearray) -> list[Slot]:
    slots = []
    for name, offset, each in block.walk(f"{instance.name}.", instance.base):
        assert isinstance(each.type, ElementaryType)
        if each.initial is not None:
            _put(initial, offset, each.type, each.initial)
        if not any(part.startswith("__") for part in name.split(".")):
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

