"""The options by which traces of other tools are read, which several commands share."""

from __future__ import annotations

import argparse

from plcemu.base.foreign import DATE, UNITS, Reading


def add_reading_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --time, --unit, --delimiter, --rename and --run."""
    group = parser.add_argument_group("files of other tools")
    group.add_argument("--time", metavar="COLUMN", help="the time column of a .csv file")
    group.add_argument("--unit", choices=(*UNITS, DATE),
                       help="the unit of its times, or 'date' for dates and times")
    group.add_argument("--delimiter", metavar="CHAR", type=_delimiter,
                       help="between its columns: comma, semicolon, tab or another character "
                       "(default: found out)")
    group.add_argument("--rename", action="append", default=[], metavar="OLD=NEW", type=_rename,
                       help="another name for a tag of the file; may be given several times")
    group.add_argument("--run", metavar="N", type=int,
                       help="the run in a historian's file (default: the last one)")


def _delimiter(text: str) -> str:
    named = {"comma": ",", "semicolon": ";", "tab": "\t", "\\t": "\t"}.get(text, text)
    if len(named) != 1:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected one character")
    return named


def _rename(text: str) -> tuple[str, str]:
    old, equals, new = text.partition("=")
    if not equals or not old.strip() or not new.strip():
        raise argparse.ArgumentTypeError(f"found {text!r}, expected OLD=NEW")
    return old.strip(), new.strip()


def reading_of(arguments: argparse.Namespace) -> Reading:
    """Return what the arguments say."""
    return Reading(arguments.time, arguments.unit, arguments.delimiter, dict(arguments.rename),
                   arguments.run)
