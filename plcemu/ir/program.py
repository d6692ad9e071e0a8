"""A compiled program: functions, the layout of memory, instances and tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from plcemu.base.spans import Diagnostic, Span
from plcemu.base.tags import Tag
from plcemu.ir.shape import Variable

Block = bytearray | memoryview
"""The memory of a running program, as everyone sees it."""


class Instr(NamedTuple):
    """One instruction: an operation of `plcemu.ir.ops`, its argument, and where it was written."""

    op: str
    arg: Any = None
    span: Span | None = None


@dataclass(frozen=True, slots=True)
class Function:
    """Code that runs on one instance.

    Attributes:
        name: unique in the program, such as `BATCH` or `BATCH.P1_on`.
        code: its instructions.
        locals: machine types of its local variables; they start at zero in every call.
        result: the machine type it returns, or empty.
        pou: the POU it belongs to, in the user's spelling.
    """

    name: str
    code: tuple[Instr, ...]
    locals: tuple[str, ...] = ()
    result: str = ""
    pou: str = ""

    def place(self, at: int) -> str:
        """Return where the instruction of that number was written, as `file:line:column`."""
        return next((str(i.span) for i in reversed(self.code[:at + 1]) if i.span), "")


@dataclass(frozen=True, slots=True)
class Slot:
    """Where a tag's value stands in memory."""

    tag: Tag
    offset: int


@dataclass(frozen=True, slots=True)
class Expiry:
    """What of a clock cell the program sees: only that `elapsed` has reached `limit`.

    So it is with a timer whose ET no text reads: until the cell expires, scans that change nothing
    else only copy the elapsed time.

    Attributes:
        copy: offset of the elapsed time's copy, ET.
        varied: offset of a BOOL that is TRUE if the limit changed while the cell ran; then the
            program may have compared with another limit than the one that stands there.
    """

    copy: int
    varied: int


@dataclass(frozen=True, slots=True)
class ClockCell:
    """An elapsed time in memory: two 64-bit integers, `elapsed` and then `limit`, in ns.

    While `elapsed` is below `limit` it runs: the resource adds the time that has passed, up to
    `limit`. So memory holds no absolute time, and states recur.

    Attributes:
        offset: of `elapsed` in the memory block.
        observed: whether the program reads it, so that its running can matter.
        expiry: of an observed cell, if its expiry is all that can matter; else None.
    """

    offset: int
    observed: bool
    expiry: Expiry | None = None


@dataclass(frozen=True, slots=True)
class ImageExtent:
    """A stretch of a process image area in memory: elements [first, first + count)."""

    area: str
    first: int
    count: int
    offset: int


@dataclass(frozen=True, slots=True)
class Layout:
    """The memory block.

    Attributes:
        initial: the whole block as it stands at a cold start.
        slots: the tags in it, in order of the tag table.
        extents: the process image in it.
        clocks: the clock cells in it.
        retained: the variables that keep their values over a warm restart, in textual order.
        variables: all variables that an edited program can take over: constants, inputs and what
            means nothing from one scan to the next are left out.
    """

    initial: bytes
    slots: tuple[Slot, ...]
    extents: tuple[ImageExtent, ...]
    clocks: tuple[ClockCell, ...]
    retained: tuple[Variable, ...] = ()
    variables: tuple[Variable, ...] = ()

    @property
    def size(self) -> int:
        """Bytes of the block."""
        return len(self.initial)


@dataclass(frozen=True, slots=True)
class Instance:
    """A program instance: its name, its function and where its variables begin."""

    name: str
    function: str
    base: int


@dataclass(frozen=True, slots=True)
class Event:
    """The rising edge that releases a task (SINGLE; IEC 61131-3, 2.7.2 and table 50).

    Attributes:
        trigger: offset of the BOOL variable in memory.
        seen: offset of the byte that holds what the trigger was when it was last looked at.
    """

    trigger: int
    seen: int


@dataclass(frozen=True, slots=True)
class Task:
    """A task; lower priority numbers run first.

    Without an event it is released at phase + k · interval; an interval of 0 means the resource's
    own cycle. An event is looked for at phase + k · the resource's cycle, and its rising edge
    releases the task once; with an interval besides, the task is also periodic while the trigger is
    FALSE.

    A run is stopped when its jumps backwards have cost more than `budget` instructions; 0 means the
    resource's budget. A run that took longer than `watchdog_ns` by the clock ends in FAULT after
    it; 0 means that none is too long.
    """

    name: str
    interval_ns: int = 0
    priority: int = 0
    phase_ns: int = 0
    programs: tuple[str, ...] = ()
    event: Event | None = None
    budget: int = 0
    watchdog_ns: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """All that an engine needs to run; two are equal if they are the same one."""

    functions: dict[str, Function]
    layout: Layout
    instances: tuple[Instance, ...]
    tasks: tuple[Task, ...]
    warnings: Sequence[Diagnostic] = field(default=())

    def instance(self, name: str) -> Instance:
        """Return the program instance of that name.

        Raises:
            KeyError: there is none.
        """
        for instance in self.instances:
            if instance.name.casefold() == name.casefold():
                return instance
        raise KeyError(name)
