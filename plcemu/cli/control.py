"""`plcemu control`: ask and command a running daemon."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.cli.output import add_set_argument, print_json
from plcemu.runtime.commands import COMMANDS
from plcemu.runtime.config import load_config
from plcemu.runtime.control import ask, socket_path

HELP = "ask and command a running daemon: status, stop, start, restart, reload, values and forces"
_EPILOG = """commands:
{commands}

examples:
  plcemu control status
  plcemu control il_programs/batch_plant get MAIN.count
  plcemu control force pump FALSE
  plcemu control restart --cold

Each is done between two scans; the answer comes when it is done. CONFIG is what the daemon was
started with: its control socket is found by that. Exit code 1 if the daemon refuses."""

EPILOG = _EPILOG.format(commands="\n".join(
    f"  {' '.join([name, *(a.upper() for a in c.arguments)]):<20} {c.summary}"
    for name, c in COMMANDS.items()))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    parser.add_argument("words", nargs="+", metavar="[CONFIG] COMMAND [NAME [VALUE]]",
                        help="what to do, perhaps after the daemon's configuration")
    parser.add_argument("--cold", action="store_true", help="restart with initial values")
    parser.add_argument("--warm", action="store_true",
                        help="restart with the retained variables as they are (the default)")
    parser.add_argument("--socket", metavar="PATH", type=Path,
                        help="the daemon's control socket, instead of that of a configuration")
    parser.add_argument("--timeout", metavar="SECONDS", type=float, default=30.0,
                        help="how long to wait for the answer (default: 30)")
    add_set_argument(parser)


class WrongUseError(PlcemuError):
    """The words on the command line make no sense."""


def execute(arguments: argparse.Namespace) -> int:
    """Send one request, print the answer, and return 1 if it was refused."""
    config, request = _request(arguments)
    path = arguments.socket or socket_path(load_config(config, arguments.overrides))
    answer = ask(path, request, arguments.timeout)
    if arguments.json:
        print_json(answer)
    elif not answer["ok"]:
        raise RefusedError(answer["error"])
    else:
        _print(request["command"], answer)
    return 0 if answer["ok"] else 1


class RefusedError(PlcemuError):
    """The daemon refused."""

    exit_code = 1


def _request(arguments: argparse.Namespace) -> tuple[str | None, dict[str, Any]]:
    """Return the configuration named, if one is, and the request."""
    words = list(arguments.words)
    config = words.pop(0) if words[0] not in COMMANDS and Path(words[0]).exists() else None
    if not words or words[0] not in COMMANDS:
        found = f"found {words[0]!r}" if words else "found no command"
        raise WrongUseError(f"{found}, expected one of {', '.join(COMMANDS)}, or a configuration "
                            "before it")
    name, values = words[0], words[1:]
    command = COMMANDS[name]
    if len(values) != len(command.arguments):
        raise WrongUseError(f"{name} takes {' '.join(a.upper() for a in command.arguments)}"
                            if command.arguments else f"{name} takes nothing more")
    request: dict[str, Any] = {"command": name, **dict(zip(command.arguments, values,
                                                           strict=True))}
    if arguments.cold or arguments.warm:
        if name != "restart" or arguments.cold == arguments.warm:
            raise WrongUseError("--cold or --warm, one of them, goes with restart")
        request["mode"] = "cold" if arguments.cold else "warm"
    return config, request


def _print(command: str, answer: dict[str, Any]) -> None:
    if command == "get":
        value = answer["value"]
        print({True: "TRUE", False: "FALSE"}[value] if isinstance(value, bool) else value)
        return
    shown = {key: value for key, value in answer.items() if key != "ok"}
    if not shown:
        print("done")
    for key, value in shown.items():
        print(f"{key}: {_text(value)}")


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(each)}" for key, each in value.items()) or "-"
    if isinstance(value, list):
        return ", ".join(map(_text, value)) or "-"
    return str(value)
