"""The function under construction: code, locals and labels, and how names become places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from plcemu.base.areas import Address
from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.base.types import ElementaryType, StringType
from plcemu.ir.program import Function, Instr
from plcemu.lang import syntax as s
from plcemu.lang.constants import NotConstant, fold
from plcemu.lang.frames import Functions
from plcemu.lang.image import read_address
from plcemu.lang.report import Report
from plcemu.lang.scope import Scope
from plcemu.lang.types import (
    BOOL,
    TYPE_OF_SIZE,
    ArrayType,
    BlockType,
    Field,
    Place,
    Subscript,
    Type,
    root,
)


def _no_subscript(_: s.Expr) -> None:
    raise AssertionError("the lowering of expressions sets how subscripts are pushed")


class Emitter:
    """Collects the code of one function of a POU.

    Args:
        scope: the POU's names.
        image_offset: gives where a direct address stands in memory.
        report: takes the mistakes.
        name: of the function.
        result: the machine type it returns, or empty.
        functions: the user's functions.
    """

    def __init__(self, scope: Scope, image_offset: Callable[[Address], int], report: Report,
                 name: str, result: str, functions: Functions) -> None:
        self.scope = scope
        self.functions = functions
        self.report = report
        self.name = name
        self.result = result
        self.code: list[Instr] = []
        self.push_subscript: Callable[[s.Expr], None] = _no_subscript
        self._image_offset = image_offset
        self._locals: list[str] = []
        self._labels = 0
        self._names: dict[str, Place] = {}
        for variable, of in scope.temporaries.values():
            self.declare_local(variable.name, of)

    def emit(self, op: str, arg: object = None, span: Span | None = None) -> None:
        """Append an instruction."""
        self.code.append(Instr(op, arg, span))

    def new_local(self, machine: str) -> int:
        """Return a fresh local variable's number."""
        self._locals.append(machine)
        return len(self._locals) - 1

    def new_label(self) -> int:
        """Return a fresh label."""
        self._labels += 1
        return self._labels

    def declare_local(self, name: str, of: ElementaryType) -> Place:
        """Give a name to a fresh local variable of this function."""
        place = Place("local", self.new_local(of.machine), of, name)
        self._names[name.upper()] = place
        return place

    def name_local(self, name: str, number: int, of: Type) -> None:
        """Give a name, which no user's variable can have, to a value in a local variable."""
        self._names[name.upper()] = Place("local", number, of, "the current result",
                                          "it is a value")

    def function(self) -> Function:
        """Return the finished function."""
        return Function(self.name, tuple(self.code), tuple(self._locals), self.result,
                        self.scope.pou.name)

    # ------------------------------------------------------------ places

    def place(self, node: s.Name | s.Direct) -> Place | None:
        """Return where a variable stands; a mistake goes to the report and gives None."""
        if isinstance(node, s.Direct):
            return self._direct(node)
        key = node.head.upper()
        place = self._names.get(key)
        if place is None:
            place = self.scope.find(key)
        else:
            self.scope.unused.pop(key, None)
        if place is None:
            self._unknown(node)
            return None
        if place.base == "unknown":
            return None
        for part in node.parts[1:]:
            inner = self._field(node, place, part) if isinstance(part, str) \
                else self._bit(node, place, part) if isinstance(part, int) \
                else self._element(node, place, part)
            if inner is None:
                return None
            place = inner
        return place

    def _field(self, node: s.Name, place: Place, part: str) -> Place | None:
        field = place.type.visible(part) if isinstance(place.type, BlockType) else None
        if field is None:
            self._no_field(node, place, part)
            return None
        read_only = place.read_only or ("it is an output" if field.section == "VAR_OUTPUT" else "")
        return replace(place, offset=place.offset + field.offset, type=field.type, name=str(node),
                       read_only=read_only)

    def _bit(self, node: s.Name, place: Place, bit: int) -> Place | None:
        """Return the place of a bit of an integer or bit string."""
        of = root(place.type)
        if not isinstance(of, ElementaryType) or of.kind not in ("bits", "uint", "int"):
            self.report.error("P0023", node.span, f"{place.name} is {of.name} and has no bits")
            return None
        if bit >= of.bits:
            self.report.error("P0025", node.span, f"{of.name} has the bits 0 to {of.bits - 1}")
            return None
        return replace(place, type=BOOL, name=str(node), holder=of, bit=bit)

    def _element(self, node: s.Name, place: Place, subscripts: tuple[s.Expr, ...]) -> Place | None:
        """Return the place of an array's element; known subscripts need no code."""
        of = place.type
        if not isinstance(of, ArrayType):
            self.report.error("P0023", node.span, f"{place.name} is no array, but {of.name}")
            return None
        if len(subscripts) != len(of.ranges):
            self.report.error("P0026", node.span, f"{place.name} has {len(of.ranges)} dimensions, "
                              f"{len(subscripts)} subscripts are given")
            return None
        offset, path, size = place.offset, list(place.path), of.size
        for expr, (low, high) in zip(subscripts, of.ranges, strict=True):
            size //= high - low + 1
            known = self._known(expr)
            if known is None:
                path.append(Subscript(expr, low, high - low + 1, size))
            elif low <= known <= high:
                offset += (known - low) * size
            else:
                self.report.error("P0025", expr.span, f"{known} is outside {low}..{high}")
                return None
        return replace(place, offset=offset, type=of.element, name=str(node), path=tuple(path))

    def _known(self, expr: s.Expr) -> int | None:
        """Return the value of a subscript that is known beforehand."""
        try:
            value = fold(expr, self.scope.lookup)
        except NotConstant:
            return None
        return value if isinstance(value, int) and not isinstance(value, bool) else None

    def value_place(self, node: s.Name | s.Direct) -> tuple[Place, Type] | None:
        """Return the place and type of a variable that holds a value."""
        place = self.place(node)
        if place is None:
            return None
        if isinstance(place.type, BlockType) and place.type.kind != "STRUCT":
            kind = "step" if place.type.kind == "STEP" else "function block instance"
            hint = f"write {node}.X" if kind == "step" else "name one of its outputs"
            self.report.error("P0023", node.span, f"{node} is a {kind}, not a value", hint)
            return None
        return place, root(place.type)

    def _direct(self, node: s.Direct) -> Place | None:
        address = read_address(node.address, node.span, self.report)
        if address is None:
            return None
        declared = self.scope.places.get(str(address))
        return declared or Place("memory", self._image_offset(address),
                                 TYPE_OF_SIZE[address.area[1]], str(address))

    def _unknown(self, node: s.Name) -> None:
        places = [*self.scope.places.values(), *self._names.values()]
        known = [p.name for p in places if not p.name.startswith("__") and " " not in p.name]
        hint = did_you_mean(node.head, known).removeprefix("; ")
        self.report.error("P0020", node.span, f"{node.head!r} is not declared", hint)

    def _no_field(self, node: s.Name, place: Place, part: str) -> None:
        known = [f.name for f in place.type.fields.values() if place.type.visible(f.name)] \
            if isinstance(place.type, BlockType) else []
        what = place.type.kind.replace("_", " ").lower() if isinstance(place.type, BlockType) \
            else place.type.name
        self.report.error("P0020", node.span, f"{place.name} ({what}) has no {part!r}",
                          did_you_mean(part, known).removeprefix("; "))

    # ------------------------------------------------------------ access

    def load(self, place: Place, of: Type, span: Span) -> None:
        """Push the value at a place; of arrays, structures and strings their address."""
        if place.holder is not None:
            self._load_bit(place, place.holder, span)
            return
        if place.base == "local":
            self.emit("get", place.offset, span)
        elif not isinstance(of, ElementaryType):
            self.push_address(place, span)
        elif place.path or place.base == "pointer":
            self._push_base(place, span)
            self.emit("loadat", (of.machine, place.offset if place.base == "pointer" else 0), span)
        else:
            self.emit("load", (of.machine, place.base, place.offset), span)

    def store(self, place: Place, of: Type, span: Span) -> None:
        """Pop a value (or the address of an array, structure or string) into a place."""
        if place.holder is not None:
            self._store_bit(place, place.holder, span)
            return
        if place.base == "local":
            self.emit("set", place.offset, span)
        elif not isinstance(of, ElementaryType):
            self._store_large(place, of, span)
        elif place.path or place.base == "pointer":
            value = self.new_local(of.machine)
            self.emit("set", value, span)
            self._push_base(place, span)
            self.emit("get", value, span)
            self.emit("storeat", (of.machine, place.offset if place.base == "pointer" else 0), span)
        else:
            self.emit("store", (of.machine, place.base, place.offset), span)

    def _load_holder(self, place: Place, of: ElementaryType, span: Span) -> str:
        """Push the variable that a bit belongs to as an unsigned number; return its type."""
        unsigned = f"u{of.bits}"
        self.load(replace(place, type=of, holder=None), of, span)
        if of.machine != unsigned:
            self.emit(f"to.{of.machine}.{unsigned}", None, span)
        return unsigned

    def _load_bit(self, place: Place, of: ElementaryType, span: Span) -> None:
        unsigned = self._load_holder(place, of, span)
        self.emit("const", (unsigned, 1 << place.bit), span)
        self.emit(f"and.{unsigned}", None, span)
        self.emit(f"to.{unsigned}.bool", None, span)

    def _store_bit(self, place: Place, of: ElementaryType, span: Span) -> None:
        value, mask = self.new_local("bool"), 1 << place.bit
        self.emit("set", value, span)
        unsigned = self._load_holder(place, of, span)
        self.emit("const", (unsigned, (1 << of.bits) - 1 - mask), span)
        self.emit(f"and.{unsigned}", None, span)
        for bits in (mask, 0):
            self.emit("const", (unsigned, bits), span)
        self.emit("get", value, span)
        self.emit("select", unsigned, span)
        self.emit(f"or.{unsigned}", None, span)
        if of.machine != unsigned:
            self.emit(f"to.{unsigned}.{of.machine}", None, span)
        self.store(replace(place, type=of, holder=None), of, span)

    def _store_large(self, place: Place, of: Type, span: Span) -> None:
        source = self.new_local("u32")
        self.emit("set", source, span)
        self.push_address(place, span)
        if isinstance(of, StringType):
            self.emit("const", ("i64", of.capacity), span)
            self.emit("get", source, span)
            self.emit("builtin", f"string.copy.{'w' if of.wide else 's'}", span)
        else:
            self.emit("get", source, span)
            self.emit("copy", of.size, span)

    def initialise(self, place: Place, field: Field, span: Span) -> None:
        """Give a variable its initial value."""
        if isinstance(field.type, ElementaryType):
            self.emit("const", (field.type.machine, field.type.unpack(field.bytes)), span)
            self.store(place, field.type, span)
        else:
            self.push_address(place, span)
            self.emit("addr", ("memory", self.functions.allocate(field.bytes)), span)
            self.emit("copy", field.type.size, span)

    def push_address(self, place: Place, span: Span) -> None:
        """Push the address of a place in memory."""
        self._push_base(place, span)
        if place.base == "pointer" and place.offset:
            self.emit("const", ("u32", place.offset), span)
            self.emit("add.u32", None, span)

    def _push_base(self, place: Place, span: Span) -> None:
        """Push a place's address; of what a pointer points at, without the offset."""
        if place.base == "pointer":
            self.emit("load", ("u32", "this", place.cell), span)
        else:
            self.emit("addr", (place.base, place.offset), span)
        for subscript in place.path:
            self.push_subscript(subscript.value)
            self.emit("index", (subscript.low, subscript.count, subscript.size), span)
            self.emit("add.u32", None, span)
