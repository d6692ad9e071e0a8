"""Declarations to one scope: variables and steps get their places in the POU's block."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType
from plcemu.lang import syntax as s
from plcemu.lang.constants import NotConstant, fold
from plcemu.lang.image import Image, name_key, read_address
from plcemu.lang.located import count_elements, is_inside, misfit
from plcemu.lang.nodes import names_in
from plcemu.lang.report import Report
from plcemu.lang.scope import Located, Scope
from plcemu.lang.sipn import FLAGS
from plcemu.lang.types import (
    BOOL,
    BlockType,
    Place,
    Type,
    default_bytes,
    root,
    step_type,
    widens,
)

if TYPE_CHECKING:
    from plcemu.lang.scopes import Declarations

MEMORY_LIMIT = 8_000_000
"""Bytes that the variables of one POU's instance may take."""

POINTER = ELEMENTARY["UDINT"]
"""What a VAR_IN_OUT holds: the address of the variable it stands for."""


class ScopeBuilder:
    """Builds one scope; of global variables `begin` is where they begin in memory."""

    def __init__(self, declarations: Declarations, pou: s.Pou, parent: Scope | None, image: Image,
                 report: Report, begin: int | None = None) -> None:
        self._begin = begin
        self._declarations, self._image, self._report = declarations, image, report
        self.scope = Scope(pou, BlockType(pou.name, pou.kind), declarations.members, parent)
        self._types = declarations.builder(self.scope)

    def build(self) -> Scope:
        """Return the scope with all its names."""
        for variable in self.scope.pou.variables:
            self._variable(variable)
        body = self.scope.pou.body
        if isinstance(body, s.SfcBody) and self.scope.pou.kind == "FUNCTION":
            self._report.error("P0010", body.span, "a FUNCTION has no memory, so it has no steps")
        elif isinstance(body, s.SipnBody) and self.scope.pou.kind == "FUNCTION":
            self._report.error("P0010", body.span, "a FUNCTION has no memory, so it has no places")
        elif isinstance(body, s.SfcBody):
            self._chart(body)
        elif isinstance(body, s.SipnBody):
            self._net(body)
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
        of = self._types.type(variable.type)
        if of is None or not self._may_stand(variable, of):
            self.scope.places[key] = Place("unknown", 0, of or BOOL, variable.name)
            return
        if variable.section == "VAR_EXTERNAL":
            self._external(variable, of)
            return
        if variable.section == "VAR_IN_OUT":
            made = self.scope.type.add(variable.name, POINTER, section="VAR_IN_OUT", target=of)
            self.scope.places[key] = Place("pointer", 0, of, variable.name, "", (), made.offset)
            return
        if variable.section == "VAR_TEMP" and isinstance(of, ElementaryType):
            self.scope.temporaries[key] = (variable, of)
            self.scope.unused[key] = variable
            return
        initial = None if variable.initial is None else self._types.initial(variable.initial, of)
        if variable.constant:
            self._constant(key, variable, of)
        if variable.address:
            self._located(variable, of, initial)
            return
        self._add(key, variable, of, initial)

    def _add(self, key: str, variable: s.Variable, of: Type, initial: bytes | None) -> None:
        read_only = "it is CONSTANT" if variable.constant else ""
        made = self.scope.type.add(variable.name, of, section=variable.section, initial=initial,
                                   constant=variable.constant, retain=variable.retain)
        base, offset = ("this", made.offset) if self._begin is None \
            else ("memory", self._begin + made.offset)
        self.scope.places[key] = Place(base, offset, of, variable.name, read_only)
        if variable.edge:
            self._edge(key, variable, of)
        if variable.section == "VAR" and not variable.constant:
            self.scope.unused[key] = variable

    def _edge(self, key: str, variable: s.Variable, of: Type) -> None:
        """Let the name stand for the edge: what the caller wrote is seen by no statement."""
        written = self.scope.places[key]
        hidden = [self.scope.type.add(f"__{variable.name}{n}", of) for n in ("_last", "_edge")]
        last, now = (replace(written, offset=made.offset) for made in hidden)
        self.scope.places[key] = now
        self.scope.edges.append((written, last, now, variable))

    def _may_stand(self, variable: s.Variable, of: Type) -> bool:
        """Whether a variable of a type may stand in its section; a mistake goes to the report."""
        kind = self.scope.pou.kind
        is_block = isinstance(of, BlockType) and of.kind == "FUNCTION_BLOCK"
        if variable.section == "VAR_IN_OUT" and kind == "PROGRAM":
            self._report.error("P0090", variable.span,
                               "VAR_IN_OUT of a PROGRAM is not supported yet; use VAR_EXTERNAL")
            return False
        holds = variable.section in ("VAR", "VAR_GLOBAL", "VAR_EXTERNAL") and kind != "FUNCTION"
        if is_block and not holds and variable.section != "VAR_IN_OUT":
            self._report.error("P0090", variable.span, f"function blocks in {variable.section} of "
                               f"a {kind} are not supported yet")
            return False
        return True

    def _external(self, variable: s.Variable, of: Type) -> None:
        key = name_key(variable.name)
        place = self.scope.parent.find(key) if self.scope.parent is not None else None
        if place is None:
            known = list(self.scope.parent.places) if self.scope.parent is not None else []
            self._report.error("P0020", variable.span,
                               f"there is no global variable {variable.name!r}",
                               did_you_mean(variable.name, known).removeprefix("; "))
            place = Place("unknown", 0, of, variable.name)
        elif place.base != "unknown" and not (widens(place.type, of) and widens(of, place.type)):
            self._report.error("P0023", variable.span, f"the global variable {variable.name!r} is "
                               f"{place.type.name}, not {of.name}")
        read_only = "it is CONSTANT" if variable.constant else place.read_only
        self.scope.places[key] = replace(place, read_only=read_only)

    def _constant(self, key: str, variable: s.Variable, of: Type) -> None:
        """Remember the value of a constant, for the expressions that must be known beforehand."""
        if not isinstance(of, ElementaryType) or variable.initial is None \
                or isinstance(variable.initial, s.ListValue | s.FieldValues):
            return
        try:
            self.scope.constants[key] = (fold(variable.initial, self.scope.lookup), of)
        except NotConstant:
            return  # reported when the initial value was made

    def _twice(self, key: str, name: str, span: Span) -> None:
        """Report a second declaration; which one is meant is not known from here on."""
        self._report.error("P0021", span, f"{name!r} is declared twice")
        self.scope.places[key] = Place("unknown", 0, BOOL, name)
        self.scope.temporaries.pop(key, None)

    def _located(self, variable: s.Variable, of: Type, initial: bytes | None) -> None:
        key, span = name_key(variable.name), variable.address_span
        if self.scope.pou.kind not in ("PROGRAM", "GLOBAL"):
            self._report.error("P0030", span,
                               "only a PROGRAM's and global variables can have an address")
        self.scope.places[key] = Place("unknown", 0, root(of), variable.name)
        if variable.address.endswith("*"):
            self._report.error("P0090", span, "incomplete addresses, which VAR_CONFIG completes, "
                               "are not supported yet; write the whole address")
            return
        address = read_address(variable.address, span, self._report)
        if address is None:
            return
        problem = misfit(of, address)
        if problem:
            self._report.error("P0031", span, problem)
            return
        if not is_inside(of, address):
            self._report.error("P0030", span,
                               f"{of.name} at {address} ends outside the process image")
            return
        if initial is None and any(data := default_bytes(of)):
            initial = data
        offset = self._image.stretch(address, count_elements(of, address))
        read_only = "it is CONSTANT" if variable.constant else ""
        self.scope.places[key] = Place("memory", offset, root(of), variable.name, read_only)
        self.scope.located.append(Located(variable.name, root(of), address, offset, initial,
                                          variable.retain, variable.constant))

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

        if self._declarations.final_scan:
            for each in body.actions:
                self._hidden(was_active(each.name), BOOL)

    def _net(self, body: s.SipnBody) -> None:
        """Declare places, transitions and flags, each a BOOL, and what conditions are held in."""
        flags = [(name, body.span, name == "eoc", "the net itself tells of it") for name in FLAGS]
        flags += [(p.name, p.span, p.initial, "only the net marks its places")
                  for p in body.places]
        flags += [(t.name, t.span, False, "the net itself tells of its transitions")
                  for t in body.transitions]
        for name, span, value, read_only in flags:
            key = name.upper()
            if key in self.scope.places or key in self.scope.temporaries:
                self._twice(key, name, span)
                continue
            made = self.scope.type.add(name, BOOL, initial=bytes([value]))
            self.scope.places[key] = Place("this", made.offset, BOOL, name, read_only)
        for transition in body.transitions:
            self._hidden(f"__holds_{transition.name}", BOOL)

    def _hidden(self, name: str, of: Type) -> None:
        made = self.scope.type.add(name, of)
        self.scope.places[name.upper()] = Place("this", made.offset, of, name)


def was_active(action: str) -> str:
    """Return the name of the hidden flag that an action with a final scan was active before."""
    return f"__WAS_{action.upper()}"


CONTROLLED = frozenset(("R", "S", "L", "D", "SD", "DS", "SL"))
"""Qualifiers that need a memory or a timer of their own; the others follow from the steps."""


def _steps_whose_time_is_read(body: s.SfcBody) -> set[str]:
    """Return the steps, in capitals, whose elapsed time T the chart's texts read."""
    texts = (*(t.condition for t in body.transitions + body.conditions),
             *(a.body for a in body.actions),
             *(a.time for step in body.steps for a in step.associations))
    return {name.head.upper() for name in names_in(texts)
            if len(name.parts) == 2 and str(name.parts[1]).upper() == "T"}
