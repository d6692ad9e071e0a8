"""The names of a POU, and where their values stand."""

from __future__ import annotations

from dataclasses import dataclass, field

from plcemu.base.areas import Address
from plcemu.base.types import ElementaryType, Value
from plcemu.lang import syntax as s
from plcemu.lang.types import (
    BlockType,
    EnumType,
    Place,
    Type,
)


@dataclass(slots=True)
class Located:
    """A variable with an address."""

    name: str
    type: Type
    address: Address
    offset: int
    initial: bytes | None = None
    retain: bool | None = None
    constant: bool = False


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
        constants: values of CONSTANT variables, by name in capitals.
        parent: the global scope, or None.
        edges: inputs with R_EDGE or F_EDGE: as written, as last seen, and the edge.
        members: names of enumerations.
        written: the variables that the POU writes, as (base, offset) of their places.
        called: the function block instances that it calls, likewise.
    """

    pou: s.Pou
    type: BlockType
    members: dict[str, tuple[EnumType, int]]
    parent: Scope | None = None
    places: dict[str, Place] = field(default_factory=dict)
    located: list[Located] = field(default_factory=list)
    temporaries: dict[str, tuple[s.Variable, ElementaryType]] = field(default_factory=dict)
    unused: dict[str, s.Variable] = field(default_factory=dict)
    constants: dict[str, tuple[Value, ElementaryType]] = field(default_factory=dict)
    edges: list[tuple[Place, Place, Place, s.Variable]] = field(default_factory=list)
    written: set[tuple[str, int]] = field(default_factory=set)
    called: set[tuple[str, int]] = field(default_factory=set)

    def mark(self, name: str, called: bool = False) -> None:
        """Remember that a variable, as a whole or in part, is written or called here."""
        place = self.find(name.upper())
        if place is not None:
            self.written.add((place.base, place.offset))
            if called:
                self.called.add((place.base, place.offset))

    def find(self, key: str) -> Place | None:
        """Return the place of a name in capitals, here or among the global variables."""
        self.unused.pop(key, None)
        place = self.places.get(key)
        if place is None and self.parent is not None:
            return self.parent.find(key)
        return place

    def lookup(self, node: s.Name | s.Literal) -> tuple[Value, ElementaryType] | None:
        """Return the value and type of a named constant or a value of an enumeration."""
        if isinstance(node, s.Literal):
            return self._typed_member(node)
        if len(node.parts) != 1:
            return None
        key = node.head.upper()
        found = self.constants.get(key)
        if found is None and key not in self.places:
            found = self.parent.constants.get(key) if self.parent is not None else None
            if found is None and self.find(key) is None and key in self.members:
                of, value = self.members[key]
                return value, of
        return found

    def _typed_member(self, node: s.Literal) -> tuple[Value, ElementaryType] | None:
        """Return the value of `TYPE#NAME`, which the lexer gives as text with its type."""
        if not node.type.endswith("#"):
            return None
        for key, (of, _) in self.members.items():
            if of.name.upper() == node.type[:-1] and key:
                members = {name.upper(): value for name, value in of.members}
                value = members.get(str(node.value).upper())
                if value is not None:
                    return value, of
        return None
