"""All scopes of a program: every POU's, its types and blocks first, and the global one."""

from __future__ import annotations

from collections.abc import Iterable

from plcemu.base.errors import did_you_mean
from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, StringType
from plcemu.lang import syntax as s
from plcemu.lang.cursor import NESTING_LIMIT
from plcemu.lang.image import Image
from plcemu.lang.report import Report
from plcemu.lang.scope import Scope
from plcemu.lang.scopebuilder import ScopeBuilder
from plcemu.lang.typebuilder import STRING_LENGTH, TypeBuilder
from plcemu.lang.types import (
    CLOCK,
    BlockType,
    EnumType,
    Type,
)

GLOBAL = "__GLOBAL"
"""The name under which the global variables have their scope."""


class Declarations:
    """Builds the scope of every POU, the types and blocks it uses first.

    Args:
        units: the library's and the user's declarations.
        image: where located variables stand.
        report: takes the mistakes.
        final_scan: whether actions run once more when they end (2.6.4.5).
    """

    def __init__(self, units: Iterable[s.Unit], image: Image, report: Report,
                 final_scan: bool = False) -> None:
        self._image, self._report = image, report
        self.final_scan = final_scan
        self._pous: dict[str, s.Pou] = {}
        self._types: dict[str, s.TypeDeclaration] = {}
        self._built: dict[str, Type | None] = {}
        self._open: list[str] = []
        self.members: dict[str, tuple[EnumType, int]] = {}
        self.scopes: dict[str, Scope] = {}
        variables: list[s.Variable] = []
        for unit in units:
            for type_ in unit.types:
                self._declare(type_)
            for pou in unit.pous:
                self._declare(pou)
            variables += unit.globals
        self.globals = self._build_globals(variables)

    def _declare(self, declared: s.Pou | s.TypeDeclaration) -> None:
        key = declared.name.upper()
        if key in self._pous or key in self._types or key in ELEMENTARY:
            self._report.error("P0021", declared.span,
                               f"there is another POU or type {declared.name!r}")
        elif isinstance(declared, s.Pou):
            self._pous[key] = declared
        else:
            self._types[key] = declared

    def _build_globals(self, variables: list[s.Variable]) -> Scope:
        """Build the scope of the global variables, which stand right behind the image."""
        base = -(-self._image.size // 8) * 8
        for declaration in self._types.values():
            if isinstance(declaration.spec, s.EnumSpec):
                self.find_type(declaration.name, declaration.span)
        span = variables[0].span if variables else next(iter(self._pous.values())).span
        pou = s.Pou(span, "GLOBAL", GLOBAL, tuple(sorted(variables, key=self._is_instance)),
                    s.StBody(span, ()))
        builder = ScopeBuilder(self, pou, None, self._image, self._report, base)
        self.globals = builder.scope  # which the function blocks among the globals may name
        return builder.build()

    def _is_instance(self, variable: s.Variable) -> bool:
        spec = variable.type
        while isinstance(spec, s.ArraySpec):
            spec = spec.element
        return isinstance(spec, s.NamedType) and spec.name.upper() in self._pous

    def scope(self, name: str) -> Scope | None:
        """Return the scope of a POU, building it first; None if it contains itself."""
        key = name.upper()
        if key in self.scopes:
            return self.scopes[key]
        pou = self._pous.get(key)
        if pou is None:
            return None  # its name is another's, which is reported
        if not self._enter(key, pou.name, pou.span):
            return None
        scope = ScopeBuilder(self, pou, self.globals, self._image, self._report).build()
        self._open.pop()
        self.scopes[key] = scope
        return scope

    def _enter(self, key: str, name: str, span: Span) -> bool:
        if key in self._open:
            chain = " contains ".join([*self._open[self._open.index(key):], key])
            self._report.error("P0060", span, f"{name} contains itself: {chain}")
            return False
        if len(self._open) >= NESTING_LIMIT:
            self._report.error("P0014", span, f"function blocks contain each other more than "
                               f"{NESTING_LIMIT} levels deep")
            return False
        self._open.append(key)
        return True

    def find_type(self, name: str, span: Span) -> Type | None:
        """Return the type of that name; a mistake goes to the report."""
        key = name.upper()
        if key in ELEMENTARY:
            return ELEMENTARY[key]
        if key in ("STRING", "WSTRING"):
            return StringType(STRING_LENGTH, key == "WSTRING")
        if key == CLOCK.name:
            return CLOCK
        if key in self._types:
            return self._declared_type(key)
        if key in self._pous and self._pous[key].kind == "FUNCTION_BLOCK":
            scope = self.scope(key)
            return scope.type if scope else None
        known = [*ELEMENTARY, *(t.name for t in self._types.values()),
                 *(p.name for p in self._pous.values() if p.kind == "FUNCTION_BLOCK")]
        self._report.error("P0022", span, f"there is no type {name!r}",
                           did_you_mean(name, known).removeprefix("; "))
        return None

    def _declared_type(self, key: str) -> Type | None:
        if key not in self._built:
            declaration = self._types[key]
            if not self._enter(key, declaration.name, declaration.span):
                return None
            self._built[key] = self.builder(None).alias(declaration)
            self._open.pop()
        return self._built[key]

    def builder(self, scope: Scope | None) -> TypeBuilder:
        """Return a builder of types that knows a scope's constants."""
        if scope is None:
            empty = s.Pou(next(iter(self._pous.values())).span, "GLOBAL", GLOBAL, (), s.StBody(
                next(iter(self._pous.values())).span, ()))
            scope = getattr(self, "globals", None) or Scope(empty, BlockType(GLOBAL, "GLOBAL"),
                                                            self.members)
        return TypeBuilder(self.find_type, scope.lookup, self.members, self._report)
