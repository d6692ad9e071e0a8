"""The function under construction: code, locals and labels, and how names become places."""

from __future__ import annotations

from collections.abc import Callable

from plcemu.base.areas import Address
from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.base.types import ElementaryType
from plcemu.ir.program import Function, Instr
from plcemu.lang import syntax as s
from plcemu.lang.report import Report
from plcemu.lang.frames import Functions
from plcemu.lang.scope import Scope, read_address
from plcemu.lang.types import TYPE_OF_SIZE, BlockType, Place


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

    def function(self) -> Function:
        """Return the finished function."""
        return Function(self.name, tuple(self.code), tuple(self._locals), self.result,
                        self.scope.pou.name)

    # ------------------------------------------------------------ places

    def place(self, node: s.Name | s.Direct) -> Place | None:
        """Return where a variable stands; a mistake goes to the report and gives None."""
        if isinstance(node, s.Direct):
            return self._direct(node)
        key = node.parts[0].upper()
        self.scope.unused.pop(key, None)
        place = self._names.get(key) or self.scope.places.get(key)
        if place is None:
            self._unknown(node)
            return None
        if place.base == "unknown":
            return None
        for part in node.parts[1:]:
            field = place.type.visible(part) if isinstance(place.type, BlockType) else None
            if field is None:
                self._no_field(node, place, part)
                return None
            read_only = place.read_only or ("it is an output" if field.section == "VAR_OUTPUT"
                                            else "")
            place = Place(place.base, place.offset + field.offset, field.type, str(node), read_only)
        return place

    def value_place(self, node: s.Name | s.Direct) -> tuple[Place, ElementaryType] | None:
        """Return the place and type of a variable that holds one elementary value."""
        place = self.place(node)
        if place is None:
            return None
        if isinstance(place.type, BlockType):
            kind = "step" if place.type.kind == "STEP" else "function block instance"
            hint = f"write {node}.X" if kind == "step" else "name one of its outputs"
            self.report.error("P0023", node.span, f"{node} is a {kind}, not a value", hint)
            return None
        return place, place.type

    def _direct(self, node: s.Direct) -> Place | None:
        address = read_address(node.address, node.span, self.report)
        if address is None:
            return None
        declared = self.scope.places.get(str(address))
        return declared or Place("memory", self._image_offset(address),
                                 TYPE_OF_SIZE[address.area[1]], str(address))

    def _unknown(self, node: s.Name) -> None:
        places = [*self.scope.places.values(), *self._names.values()]
        known = [p.name for p in places if not p.name.startswith("__")]
        hint = did_you_mean(node.parts[0], known).removeprefix("; ")
        self.report.error("P0020", node.span, f"{node.parts[0]!r} is not declared", hint)

    def _no_field(self, node: s.Name, place: Place, part: str) -> None:
        known = [f.name for f in place.type.fields.values() if place.type.visible(f.name)] \
            if isinstance(place.type, BlockType) else []
        what = place.type.kind.replace("_", " ").lower() if isinstance(place.type, BlockType) \
            else place.type.name
        self.report.error("P0020", node.span, f"{place.name} ({what}) has no {part!r}",
                          did_you_mean(part, known).removeprefix("; "))

    # ------------------------------------------------------------ access

    def load(self, place: Place, of: ElementaryType, span: Span) -> None:
        """Push the value at a place."""
        if place.base == "local":
            self.emit("get", place.offset, span)
        else:
            self.emit("load", (of.machine, place.base, place.offset), span)

    def store(self, place: Place, of: ElementaryType, span: Span) -> None:
        """Pop a value into a place."""
        if place.base == "local":
            self.emit("set", place.offset, span)
        else:
            self.emit("store", (of.machine, place.base, place.offset), span)
