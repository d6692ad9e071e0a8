"""Tags: every observable value has a name, a type and perhaps a unit and an address."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from plcemu.base.errors import UnknownNameError
from plcemu.base.types import Value


@dataclass(frozen=True, slots=True)
class Tag:
    """One observable value.

    Attributes:
        name: the full dotted name, such as `MAIN.FILL.X`, `plant.B1.level`, `monitor.PS1.verdict`.
        type: an elementary type's name, or `STRING`.
        unit: of the value, such as `l` or `degC`; empty if it has none.
        address: the directly represented variable, such as `%QX0.1`; empty if not located.
        comment: what it is, in the user's words.
        values: of an enumeration, its values as (name, number).
    """

    name: str
    type: str
    unit: str = ""
    address: str = ""
    comment: str = ""
    values: tuple[tuple[str, int], ...] = ()

    def shown(self, value: Value | None) -> str:
        """Return a value as people read it: by its name in an enumeration, `-` if it is unknown."""
        if value is None:
            return "-"
        if isinstance(value, bool):
            return str(value).upper()
        return next((name for name, number in self.values if number == value), str(value))


class TagTable:
    """The tags of one resource, plant or trace, in a fixed order; names are case-insensitive."""

    def __init__(self, tags: Iterable[Tag] = ()) -> None:
        self._tags: list[Tag] = []
        self._full: dict[str, int] = {}
        self._short: dict[str, list[int]] = {}
        self._address: dict[str, int] = {}
        self._giving_way: set[int] = set()
        for tag in tags:
            self.add(tag)

    def add(self, tag: Tag, gives_way: bool = False) -> int:
        """Append a tag and return its index.

        Args:
            tag: the tag.
            gives_way: whether it answers to an ending of its name only if no other tag does.

        Raises:
            ValueError: a tag of that full name is there already.
        """
        key = tag.name.casefold()
        if key in self._full:
            raise ValueError(f"there are two tags {tag.name!r}")
        index = len(self._tags)
        self._tags.append(tag)
        self._full[key] = index
        parts = key.split(".")
        for i in range(1, len(parts)):
            self._short.setdefault(".".join(parts[i:]), []).append(index)
        if gives_way:
            self._giving_way.add(index)
        if tag.address:
            self._address.setdefault(tag.address.casefold(), index)
        return index

    def find(self, name: str) -> int:
        """Return the index of the tag with this full name, address, or ending of a name.

        Of several tags whose names end so, the one with the fewest parts is meant: `q` is the
        program's own variable rather than the output of a timer in it. Tags that give way are meant
        only if there are no others.

        Raises:
            UnknownNameError: no tag answers to the name, or several do.
        """
        key = name.strip().casefold()
        index = self._full.get(key)
        if index is None:
            index = self._address.get(key)
        if index is not None:
            return index
        matches = self._outermost(self._short.get(key, []))
        if len(matches) == 1:
            return matches[0]
        if matches:
            names = ", ".join(self._tags[i].name for i in matches[:5])
            error = UnknownNameError("single tag", name, ())
            error.message = f"{name!r} is not unique; write one of {names}"
            raise error
        raise UnknownNameError("tag", name, [t.name for t in self._tags] + list(self._short))

    def _outermost(self, matches: list[int]) -> list[int]:
        matches = [i for i in matches if i not in self._giving_way] or matches
        parts = [self._tags[i].name.count(".") for i in matches]
        return [i for i, n in zip(matches, parts, strict=True) if n == min(parts)]

    def __contains__(self, name: object) -> bool:
        try:
            self.find(str(name))
        except UnknownNameError:
            return False
        return True

    def __getitem__(self, key: int | str) -> Tag:
        return self._tags[key if isinstance(key, int) else self.find(key)]

    def __iter__(self) -> Iterator[Tag]:
        return iter(self._tags)

    def __len__(self) -> int:
        return len(self._tags)
