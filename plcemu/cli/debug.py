"""`plcemu debug`: step a PLC with its plant by scan, step, line and instruction, back and forth."""

from __future__ import annotations

import argparse
import cmd
import linecache
import shlex
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.base.time import DurationError, format_duration, parse_duration_ns
from plcemu.base.types import Value
from plcemu.cli.output import add_config_arguments, print_json, show_warnings
from plcemu.engine.tracer import Event
from plcemu.runtime.config import load_config
from plcemu.runtime.debugger import DebugError, Debugger, Stop, Why
from plcemu.runtime.system import System

HELP = "step PLC and plant through virtual time, by scan, step, line and instruction, and back"
EPILOG = """Commands come from the terminal, from a pipe, or from --execute; `help` lists them. In a
pipe or with --execute the exit code is 2 if a command was wrong.

examples:
  plcemu debug il_programs/batch_plant
  plcemu debug --execute "watch pump; run; trace pump; back; print count" """

EVENTS_SHOWN = 200
"""The largest number of instructions that `trace` prints."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    add_config_arguments(parser)
    parser.add_argument("--no-plant", action="store_true", help="run no plant")
    parser.add_argument("--execute", dest="script", metavar="COMMANDS", action="append",
                        default=[],
                        help="execute these commands, separated by semicolons, and end")


def execute(arguments: argparse.Namespace) -> int:
    """Take commands until `quit` or the end of input."""
    system = System(load_config(arguments.config, arguments.overrides),
                    with_plant=not arguments.no_plant)
    if not arguments.json:
        show_warnings(system.warnings)
    by_hand = sys.stdin.isatty() and not arguments.script and not arguments.json
    with Debugger(system) as debugger:
        shell = Shell(debugger, by_hand, arguments.json)
        if arguments.script:
            shell.take(c for text in arguments.script for c in text.split(";"))
        elif by_hand:
            shell.cmdloop()
        else:
            shell.take(sys.stdin)
    if arguments.json:
        print_json({"commands": shell.log})
    return 2 if shell.failed and not by_hand else 0


class Shell(cmd.Cmd):
    """The commands; each method's first line is its help."""

    intro = "`help` lists the commands, `quit` ends. A command may be shortened: `sc 10`."
    prompt = "(plcemu) "

    def __init__(self, debugger: Debugger, by_hand: bool, quiet: bool) -> None:
        super().__init__()
        self.debugger = debugger
        self.by_hand = by_hand
        self.quiet = quiet
        self.failed = False
        self.log: list[dict[str, Any]] = []
        self._said: list[str] = []
        self.use_rawinput = by_hand

    # ------------------------------------------------------------ taking commands

    def take(self, lines: Iterable[str]) -> None:
        """Execute commands until one of them is `quit`."""
        for line in lines:
            if line.strip() and not line.lstrip().startswith("#") and self.onecmd(line.strip()):
                return

    def onecmd(self, line: str) -> bool:
        """Execute a command; a mistake is told and changes nothing."""
        self._said = []
        entry: dict[str, Any] = {"command": line}
        over = False
        try:
            over = bool(super().onecmd(self._in_full(line)))
        except (PlcemuError, ValueError, DurationError) as problem:
            self.failed = True
            entry["error"] = str(problem)
            print(f"{problem}", file=sys.stderr if not self.by_hand else sys.stdout)
        entry["output"] = self._said
        self.log.append(entry)
        return over

    def _in_full(self, line: str) -> str:
        """Return a line with its command written in full."""
        word, space, rest = line.partition(" ")
        if word == "EOF" or not word:
            return line
        names = [name[3:] for name in self.get_names() if name.startswith("do_")]
        found = [n for n in names if n == word] or sorted(n for n in names if n.startswith(word))
        if not found:
            raise DebugError(f"there is no command {word!r}; `help` lists them")
        best = next((n for n in _FIRST if n in found), found[0])
        if len(found) > 1 and best not in _FIRST:
            raise DebugError(f"{word!r} may be {' or '.join(found)}")
        return f"{best}{space}{rest}"

    def emptyline(self) -> bool:
        """Do nothing on an empty line."""
        return False

    def say(self, text: str) -> None:
        """Print a line, unless all goes into one JSON document."""
        self._said.append(text)
        if not self.quiet:
            print(text)

    def tell(self, stop: Stop) -> None:
        """Say where the debugger stopped, and why."""
        why = "" if stop.why is Why.STEP else f"{stop.why.value}: "
        if stop.text or why:
            self.say(f"{why}{stop.text}".rstrip(": ") if stop.text else f"{stop.why.value} reached")
        where = "in" if stop.event else "before"
        self.say(f"{where} scan {stop.scan}, t = {format_duration(stop.t_ns)}, "
                 f"{self.debugger.cycle.resource.state.value}")
        if stop.event is not None:
            self.say(f"{place(stop.event)}{stop.event}")

    # ------------------------------------------------------------ going on

    def do_step(self, text: str) -> None:
        """step [N]: go on by N instructions, into calls; from between two scans, into the next."""
        self.tell(self.debugger.step(_count(text)))

    def do_next(self, text: str) -> None:
        """next [N]: go on by N lines, over calls."""
        for _ in range(_count(text)):
            stop = self.debugger.next()
        self.tell(stop)

    def do_scan(self, text: str) -> None:
        """scan [N]: end the scan looked at, or execute one; N of them."""
        self.tell(self.debugger.scan(_count(text)))

    def do_chart(self, text: str) -> None:
        """chart: execute scans until a step of a chart is entered or left."""
        self.tell(self.debugger.chart())

    def do_run(self, text: str) -> None:
        """run [DURATION]: execute scans until something stops it, at most for so long."""
        until = self.debugger.cycle.t_ns + parse_duration_ns(text) if text else None
        self.tell(self.debugger.run(until))

    do_continue = do_run

    def do_until(self, text: str) -> None:
        """until INSTANT | CONDITION: execute scans until t is 2s, or until n > 3 holds."""
        if not text:
            raise DebugError("write `until 2s` or `until n > 3`")
        self.tell(self.debugger.until(text))

    def do_back(self, text: str) -> None:
        """back [N]: go back by N scans; inside a scan, to before it."""
        self.tell(self.debugger.back(_count(text)))

    def do_rstep(self, text: str) -> None:
        """rstep [N]: go back by N instructions, within the scan."""
        self.tell(self.debugger.step_back(_count(text)))

    # ------------------------------------------------------------ stopping

    def do_break(self, text: str) -> None:
        """break [PLACE]: stop at a line (12, main.st:12), a POU or an action; alone: list them."""
        if text:
            self.say(f"breakpoint at {self.debugger.break_at(text)}")
        else:
            self.do_info("")

    def do_watch(self, text: str) -> None:
        """watch TAG...: stop where a tag changes; alone: list them."""
        for name in shlex.split(text):
            self.say(f"watching {self.debugger.watch(name)}")
        if not text:
            self.do_info("")

    def do_clear(self, text: str) -> None:
        """clear [PLACE | TAG]: end a breakpoint or a watch; alone: all of them."""
        self.debugger.clear(text or None)

    # ------------------------------------------------------------ looking

    def do_print(self, text: str) -> None:
        """print [TAG...]: show values as they are here; alone: of all tags of the program."""
        names = shlex.split(text) or [t.name for t in self.debugger.cycle.resource.memory.tags]
        for name in names:
            self.say(f"{name} = {self.debugger.read(name)!r}")

    def do_trace(self, text: str) -> None:
        """trace [TAG]: show the instructions of the scan looked at, or those that wrote a tag."""
        trace = self.debugger.trace
        if trace is None:
            raise DebugError("no scan was looked into yet; `step` looks into the next one")
        events = trace.events
        if text:
            tags = self.debugger.cycle.resource.memory.tags
            events = trace.writers(tags[tags.find(text)].name)
        self.say(f"scan {trace.scan}, t = {format_duration(trace.t_ns)}: {len(events)} of "
                 f"{len(trace.events)} instructions")
        for event in events[:EVENTS_SHOWN]:
            self.say(f"{'  ' * event.depth}{place(event)}{event}")
        if len(events) > EVENTS_SHOWN:
            self.say(f"... {len(events) - EVENTS_SHOWN} more; name a tag to see what wrote it")

    def do_info(self, text: str) -> None:
        """info: show where the debugger stands, breakpoints, watches and how far back goes."""
        debugger = self.debugger
        history = debugger.history
        self.tell(debugger.here())
        for name, which in (("breakpoints", debugger.breakpoints), ("watches", debugger.watches)):
            self.say(f"{name}: {', '.join(which) or 'none'}")
        self.say(f"history: from scan {history.first_scan} to {history.end_scan}, "
                 f"{history.size} of {history.limit_bytes} bytes")

    # ------------------------------------------------------------ acting

    def do_set(self, text: str) -> None:
        """set TAG = VALUE: write a value; the next scan takes it."""
        self._give(text, self.debugger.access.write)

    def do_force(self, text: str) -> None:
        """force TAG = VALUE: hold a value from the next scan on."""
        self._give(text, self.debugger.access.force)

    def do_unforce(self, text: str) -> None:
        """unforce TAG: end a force."""
        self.debugger.access.unforce(text)

    def _give(self, text: str, give: Callable[[str, Value], None]) -> None:
        name, equals, value = text.partition("=")
        if not equals:
            raise DebugError("write TAG = VALUE")
        give(name.strip(), _value(value.strip()))

    def do_quit(self, text: str) -> bool:
        """quit: end."""
        return True

    def do_EOF(self, text: str) -> bool:
        return True


_FIRST = ("step", "next", "scan", "continue", "run", "break", "print", "trace", "watch", "quit")
"""The commands meant by a beginning that fits several, the first one first."""


def place(event: Event) -> str:
    """Return where an instruction was written, with the line of its file, for the eye."""
    if event.line is None:
        return ""
    name, number = event.line
    text = linecache.getline(name, number).strip()
    return f"{Path(name).name}:{number}{f' `{text}`' if text else ''}  "


def _count(text: str) -> int:
    if not text:
        return 1
    if not text.isdigit() or int(text) < 1:
        raise DebugError(f"found {text!r}, expected a number of 1 or more")
    return int(text)


def _value(text: str) -> Value:
    """Read a value: TRUE, FALSE, a number, a text in quotes, or else the text (a duration)."""
    if text.upper() in ("TRUE", "FALSE"):
        return text.upper() == "TRUE"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"" else text
