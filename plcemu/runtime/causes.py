"""Causes: a value, what made it so, and what made that so; as a tree of text and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from plcemu.base.time import NS_PER_S, format_duration
from plcemu.base.types import Value

LEAVES = {
    "input": "came from outside", "constant": "a constant", "initial": "as at the start",
    "safe": "a safe value: the PLC does not run", "forced": "forced", "fact": "not the program's",
    "seen": "explained above", "depth": "deeper than shown", "record": "older than the record",
    "restart": "made so between two scans"}
"""Kinds of causes that have no causes of their own, and what they mean."""


@dataclass(slots=True)
class Cause:
    """A value and what made it so.

    Attributes:
        tag: in the user's spelling.
        value: that it has.
        kind: `assignment`, `step`, `block` (an output of a standard function block), `clock` (a
            time that passes), or one of `LEAVES`.
        t_ns: the release of the scan that wrote it.
        scan: the number of that scan.
        since_ns: since when it has had the value, as far as recorded.
        file: where the instruction is written; empty for a leaf without one.
        line: from 1; 0 for none.
        text: the line.
        type: of the tag.
        note: who wrote an input, how long a timer has run, and the like.
        causes: what it depends on.
    """

    tag: str
    value: Value | None
    kind: str
    t_ns: int
    scan: int
    since_ns: int | None = None
    file: str = ""
    line: int = 0
    text: str = ""
    note: str = ""
    type: str = ""
    causes: list[Cause] = field(default_factory=list)

    def walk(self) -> Iterator[Cause]:
        """Yield this cause and all below it."""
        yield self
        for cause in self.causes:
            yield from cause.walk()

    @property
    def leaves(self) -> list[Cause]:
        """Where the branches end."""
        return [cause for cause in self.walk() if not cause.causes]

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values, times in s."""
        since = self.since_ns
        return {"tag": self.tag, "value": self.value, "kind": self.kind,
                "t_s": self.t_ns / NS_PER_S, "scan": self.scan,
                "since_s": None if since is None else since / NS_PER_S, "file": self.file,
                "line": self.line, "text": self.text, "note": self.note,
                "causes": [cause.as_json() for cause in self.causes]}

    def __str__(self) -> str:
        return "\n".join(self._lines("", ""))

    def _lines(self, head: str, below: str) -> Iterator[str]:
        yield head + self._line()
        for n, cause in enumerate(self.causes, 1):
            last = n == len(self.causes)
            yield from cause._lines(below + ("└─ " if last else "├─ "),
                                    below + ("   " if last else "│  "))

    def _line(self) -> str:
        parts = [f"{self.tag} = {self._shown()}"]
        if self.since_ns is not None:
            parts.append(f"since {format_duration(self.since_ns)}")
        if self.note:
            parts.append(self.note)
        if self.kind in LEAVES and (self.kind == "seen" or not self.note):
            parts.append(LEAVES[self.kind])
        if self.file:
            parts.append(f"{self.file}:{self.line}  {self.text}")
        return "  ".join(parts)


    def _shown(self) -> str:
        if isinstance(self.value, bool):
            return "TRUE" if self.value else "FALSE"
        if self.type in ("TIME", "LTIME") and isinstance(self.value, int):
            return f"T#{format_duration(self.value)}"
        return "unknown" if self.value is None else repr(self.value)
