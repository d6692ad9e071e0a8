"""Declarations to block types and scopes: which names a POU knows, and where their values stand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from plcemu.base.areas import SIZES, Address, parse_address
from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType, Value
from plcemu.ir.program import ImageExtent
from plcemu.lang import syntax as s
from plcemu.lang.cursor import NESTING_LIMIT
from plcemu.lang.report import Report
from plcemu.lang.types import CLOCK, BlockType, Place, Type, step_type, widens

MEMORY_LIMIT = 1_000_000
"""Bytes that the variables of one POU's instance may take."""

_GAP = 64
"""Unused elements between two used ones that still share an extent of the image."""


@dataclass(slots=True)
class Located:
    """A variable with an address."""

    name: str
    type: ElementaryType
    address: Address
    offset: int
    initial: Value | None = None


@dataclass(slots=True)
class Scope:
    """The names of one POU.

    Attributes:
        pou: its syntax.
        type: its layout; instances begin at `this`.
        places: by name in capitals.
        located: its variables with an address.
        temporaries: VAR_TEMP variables: names in capitals to declarations; each function that the
            POU becomes holds them as locals.
        unused: variables not yet read or written, by name in capitals.
    """

    pou: s.Pou
    type: BlockType
    places: dict[str, Place] = field(default_factory=dict)
    located: list[Located] = field(default_factory=list)
    temporaries: dict[str, tuple[s.Variable, ElementaryType]] = field(default_factory=dict)
    unused: dict[str, s.Variable] = field(default_factory=dict)


class Image:
    """The stretches of the process image that a program uses, at the start of memory."""

    def __init__(self, addresses: Iterable[Address]) -> None:
        used: dict[str, list[int]] = {}
        for address in addresses:
            used.setdefault(address.area, []).append(address.index)
        self.extents: list[ImageExtent] = []
        self.size = 0
        for area in sorted(used):
            for first, last in _runs(sorted(set(used[area])), area[1] == "X"):
                width = SIZES[area[1]]
                self.size = -(-self.size // width) * width
                self.extents.append(ImageExtent(area, first, last - first + 1, self.size))
                self.size += (last - first + 1) * width

    def offset(self, address: Address) -> int:
        """Return where an address stands in memory; it must be one given to the constructor."""
        for extent in self.extents:
            if extent.area == address.area and 0 <= address.index - extent.first < extent.count:
                return extent.offset + (address.index - extent.first) * SIZES[address.area[1]]
        raise KeyError(str(address))


def _runs(indices: list[int], bits: bool) -> list[tuple[int, int]]:
    """Join sorted indices into (first, last) runs; runs of bits begin and end at whole bytes."""
    runs: list[tuple[int, int]] = []
    for index in indices:
        first, last = (index // 8 * 8, index // 8 * 8 + 7) if bits else (index, index)
        if runs and first - runs[-1][1] <= _GAP:
            runs[-1] = (runs[-1][0], max(last, runs[-1][1]))
        else:
            runs.append((first, last))
    return runs


class Declarations:
    """Builds the scope of every POU, the blocks it contains first.

    Args:
        pous: of the library and of the user.
        image: where located variables stand.
        report: takes the mistakes.
    """

    def __init__(self, pous: Iterable[s.Pou], image: Image, report: Report) -> None:
        self._image = image
        self._report = report
        self._pous: dict[str, s.Pou] = {}
        self.scopes: dict[str, Scope] = {}
        self._open: list[str] = []
        for pou in pous:
            key = pou.name.upper()
            if key in self._pous or key in ELEMENTARY:
                report.error("P0021", pou.span, f"there is another POU or type {pou.name!r}")
            else:
                self._pous[key] = pou

    def scope(self, name: str) -> Scope | None:
        """Return the scope of a POU, building it first; None if it contains itself."""
        key = name.upper()
        if key in self.scopes:
            return self.scopes[key]
        pou = self._pous[key]
        if key in self._open:
            chain = " contains ".join([*self._open[self._open.index(key):], key])
            self._report.error("P0060", pou.span, f"{pou.name} contains itself: {chain}")
            return None
        if len(self._open) >= NESTING_LIMIT:
            self._report.error("P0014", pou.span, f"function blocks contain each other more than "
                               f"{NESTING_LIMIT} levels deep")
            return None
        self._open.append(key)
        scope = _Builder(self, pou, self._image, self._report).build()
        self._open.pop()
        self.scopes[key] = scope
        return scope

    def find_type(self, name: str, span: Span) -> Type | None:
        """Return the type of that name; a mistake goes to the report."""
        key = name.upper()
        if key in ELEMENTARY:
            return ELEMENTARY[key]
        if key == CLOCK.name:
            return CLOCK
        if key in self._pous and self._pous[key].kind == "FUNCTION_BLOCK":
            scope = self.scope(key)
            return scope.type if scope else None
        known = [*ELEMENTARY, *(p.name for p in self._pous.values() if p.kind != "PROGRAM")]
        self._report.error("P0022", span, f"there is no type {name!r}",
                           did_you_mean(name, known).removeprefix("; "))
        return None


class _Builder:
    """Builds one scope."""

    def __init__(self, declarations: Declarations, pou: s.Pou, image: Image,
                 report: Report) -> None:
        self._declarations, self._image, self._report = declarations, image, report
        self.scope = Scope(pou, BlockType(pou.name, pou.kind))

    def build(self) -> Scope:
        for variable in self.scope.pou.variables:
            self._variable(variable)
        body = self.scope.pou.body
        if isinstance(body, s.SfcBody):
            self._chart(body)
        self.scope.type.size = -(-self.scope.type.size // 8) * 8
        if self.scope.type.size > MEMORY_LIMIT:
            self._report.error("P0100", self.scope.pou.span, f"an instance of "
                               f"{self.scope.pou.name} needs more than {MEMORY_LIMIT} bytes")
            self.scope.type = BlockType(self.scope.pou.name, self.scope.pou.kind)
        return self.scope

    def _variable(self, variable: s.Variable) -> None:
        key = name_key(variable.name)
        if key in self.scope.places or key in self.scope.temporaries:
            self._twice(key, variable.name, variable.span)
            return
        of = self._declarations.find_type(variable.type, variable.type_span)
        if of is None:
            self.scope.places[key] = Place("unknown", 0, ELEMENTARY["BOOL"], variable.name)
            return
        initial = self._initial(variable, of)
        if isinstance(of, BlockType) and variable.section != "VAR":
            self._report.error("P0090", variable.span,
                               f"function blocks in {variable.section} are not supported yet")
            self.scope.places[key] = Place("unknown", 0, of, variable.name)
            return
        if variable.section == "VAR_TEMP":
            assert isinstance(of, ElementaryType)
            self.scope.temporaries[key] = (variable, of)
            return
        read_only = "it is CONSTANT" if variable.constant else ""
        if variable.address:
            self._located(variable, of, initial)
            return
        made = self.scope.type.add(variable.name, of, section=variable.section, initial=initial,
                                   constant=variable.constant)
        self.scope.places[key] = Place("this", made.offset, of, variable.name, read_only)
        if variable.section == "VAR" and not variable.constant:
            self.scope.unused[key] = variable

    def _twice(self, key: str, name: str, span: Span) -> None:
        """Report a second declaration; which one is meant is not known from here on."""
        self._report.error("P0021", span, f"{name!r} is declared twice")
        self.scope.places[key] = Place("unknown", 0, ELEMENTARY["BOOL"], name)
        self.scope.temporaries.pop(key, None)

    def _initial(self, variable: s.Variable, of: Type) -> Value | None:
        if variable.initial is None:
            return None
        if isinstance(of, BlockType):
            self._report.error("P0090", variable.initial.span,
                               "initial values of function block instances are not supported yet")
            return None
        return constant_value(variable.initial, of, self._report)

    def _located(self, variable: s.Variable, of: Type, initial: Value | None) -> None:
        key, span = name_key(variable.name), variable.address_span
        if self.scope.pou.kind != "PROGRAM":
            self._report.error("P0030", span, "only a PROGRAM's variables can have an address")
        address = read_address(variable.address, span, self._report)
        if address is None or not isinstance(of, ElementaryType):
            self.scope.places[key] = Place("unknown", 0, of, variable.name)
            if address is not None:
                self._report.error("P0031", span, "a function block instance has no address")
            return
        bits = 1 if address.area[1] == "X" else 8 * SIZES[address.area[1]]
        if of.bits != bits:
            self._report.error("P0031", span, f"{variable.address} holds {bits} bit"
                               f"{'s' if bits > 1 else ''}, {of.name} needs {of.bits}")
        offset = self._image.offset(address)
        self.scope.places[key] = Place("memory", offset, of, variable.name)
        self.scope.located.append(Located(variable.name, of, address, offset, initial))

    def _chart(self, body: s.SfcBody) -> None:
        read = _steps_whose_time_is_read(body)
        self._hidden("__started", ELEMENTARY["BOOL"])
        for step in body.steps:
            key = step.name.upper()
            if key in self.scope.places:
                self._twice(key, step.name, step.span)
                continue
            of = step_type(key in read)
            made = self.scope.type.add(step.name, of)
            self.scope.places[key] = Place("this", made.offset, of, step.name,
                                           "only the chart changes its steps")
        for action in sorted({a.action.upper() for step in body.steps for a in step.associations
                              if a.qualifier in CONTROLLED}):
            control = self._declarations.find_type("__ACTION_CONTROL", body.span)
            if control is not None:
                self._hidden(f"__control_{action}", control)

    def _hidden(self, name: str, of: Type) -> None:
        made = self.scope.type.add(name, of)
        self.scope.places[name.upper()] = Place("this", made.offset, of, name)


CONTROLLED = frozenset(("R", "S", "L", "D", "SD", "DS", "SL"))
"""Qualifiers that need a memory or a timer of their own; the others follow from the steps."""


def _steps_whose_time_is_read(body: s.SfcBody) -> set[str]:
    """Return the steps, in capitals, whose elapsed time T the chart's texts read."""
    found: set[str] = set()
    pending: list[object] = [t.condition for t in body.transitions] + [a.body for a in body.actions]
    while pending:
        node = pending.pop()
        if isinstance(node, s.Name):
            if len(node.parts) == 2 and node.parts[1].upper() == "T":
                found.add(node.parts[0].upper())
        elif isinstance(node, tuple):
            pending.extend(node)
        elif hasattr(node, "__dataclass_fields__") and not isinstance(node, Span):
            pending.extend(getattr(node, name) for name in node.__dataclass_fields__)
    return found


def name_key(name: str) -> str:
    """Return a name as scopes know it: in capitals, a direct address in its usual form."""
    try:
        return str(parse_address(name)) if name.startswith("%") else name.upper()
    except ValueError:
        return name.upper()


def read_address(text: str, span: Span, report: Report) -> Address | None:
    """Read an address; a mistake goes to the report."""
    try:
        return parse_address(text)
    except ValueError as problem:
        report.error("P0030", span, str(problem))
        return None


def addresses_in(tokens: Iterable[object]) -> list[Address]:
    """Return the valid addresses among tokens; mistakes are reported where they are used."""
    found = []
    for token in tokens:
        if getattr(token, "kind", "") == "direct":
            try:
                found.append(parse_address(str(getattr(token, "text", ""))))
            except ValueError:
                continue
    return found


def constant_value(expr: s.Expr, of: ElementaryType, report: Report) -> Value | None:
    """Return a literal's value as the nearest one of a type; mistakes go to the report."""
    sign, literal = 1, expr
    while isinstance(literal, s.Unary) and literal.op == "NEG":
        sign, literal = -sign, literal.operand
    if not isinstance(literal, s.Literal):
        report.error("P0027", expr.span, "a literal is expected here")
        return None
    if not literal_fits(literal, of):
        report.error("P0023", expr.span, f"this literal is no value of type {of.name}")
        return None
    value = literal.value
    assert not isinstance(value, str)
    try:
        return of.unpack(of.pack(bool(value) if of.kind == "bool" else sign * value))
    except ValueError as problem:
        report.error("P0025", expr.span, str(problem))
        return None


_LITERAL_KINDS: Mapping[str, tuple[str, ...]] = {
    "int": ("int", "uint", "bits", "float", "bool"), "real": ("float",), "time": ("time",),
    "bool": ("bool",), "string": ()}


def literal_fits(literal: s.Literal, of: ElementaryType) -> bool:
    """Whether a literal can be of a type, apart from its range."""
    if literal.type and literal.type in ELEMENTARY and literal.kind != "time":
        return widens(ELEMENTARY[literal.type], of)
    if literal.kind == "int" and of.kind == "bool":
        return literal.value in (0, 1)
    return of.kind in _LITERAL_KINDS[literal.kind]
