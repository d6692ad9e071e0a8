"""`plcemu`: the table of commands, and how mistakes end.

Exit codes: 0 holds, 1 a verdict failed or a diagnostic was found, 2 wrong usage or configuration.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from plcemu import __version__
from plcemu.base.errors import CompileError, ConfigError, PlcemuError
from plcemu.cli.output import print_json

COMMANDS = ("check", "run", "control", "simulate", "plant", "monitor", "verify", "schedule",
            "reach", "sweep", "debug", "why", "history")
"""Each is a module beside this one, with `HELP`, `add_arguments(parser)` and
`execute(arguments) -> exit code`. Only that of the given command is loaded: a daemon that was
killed is back sooner."""

HOLDS, FAILED, WRONG_USE = 0, 1, 2


def make_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the whole command line; with `only` that command alone is complete."""
    parser = argparse.ArgumentParser(
        prog="plcemu", description="A PLC runtime emulator: IEC 61131-3 programs in a scan cycle, "
        "served over Modbus, coupled to soft plants, watched by temporal monitors.")
    parser.add_argument("--version", action="version", version=f"plcemu {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        if only not in (None, name):
            commands.add_parser(name)
            continue
        module = import_module(f"plcemu.cli.{name}")
        sub = commands.add_parser(name, help=module.HELP, description=module.HELP,
                                  epilog=getattr(module, "EPILOG", None),
                                  formatter_class=argparse.RawDescriptionHelpFormatter,
                                  allow_abbrev=False)
        sub.add_argument("--json", action="store_true",
                         help="print one JSON document and nothing else on stdout")
        module.add_arguments(sub)
        sub.set_defaults(execute=module.execute)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code; a user's mistake never shows a traceback."""
    _prepare_streams()
    given = sys.argv[1:] if arguments is None else list(arguments)
    first = given[0] if given else None
    parsed = make_parser(first if first in COMMANDS else None).parse_args(given)
    try:
        code: int = parsed.execute(parsed)
        sys.stdout.flush()
        return code
    except CompileError as error:
        code = WRONG_USE if error.is_unreadable else FAILED
        return _fail(parsed, code, "diagnostics", [d.as_json() for d in error.diagnostics], error)
    except ConfigError as error:
        return _fail(parsed, WRONG_USE, "problems", error.problems, error)
    except PlcemuError as error:
        code = getattr(error, "exit_code", WRONG_USE)
        return _fail(parsed, code, "problems", [str(error)], error)
    except KeyboardInterrupt:
        print("plcemu: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        what = f"{error.filename}: " if error.filename else ""
        text = f"plcemu: {what}{error.strerror or error}"
        return _fail(parsed, WRONG_USE, "problems", [text], text)


def _prepare_streams() -> None:
    """Let output never fail for want of a character or of a stream."""
    if sys.stdout is None:  # started with a closed stdout
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _fail(parsed: argparse.Namespace, code: int, key: str, problems: object,
          error: object) -> int:
    with contextlib.suppress(OSError):  # the mistake may be that nothing can be written
        if parsed.json:
            print_json({"error": str(error), key: problems})
            sys.stdout.flush()
        print(error, file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
