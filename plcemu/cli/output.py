"""What the commands print: JSON documents, tables of results, log lines."""

from __future__ import annotations

import argparse
import datetime
import json
import logging
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plcemu.base.spans import Diagnostic
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.runtime.scenario import Scenario, load_scenario, parse_fault

if TYPE_CHECKING:  # loaded where something is drawn: it takes long, and a daemon may not
    from rich.console import Console
    from rich.table import Table

LIMITED = 20
"""Warnings that `run` and `simulate` show before the rest is only counted."""

NARROW = (60, 90)
"""Columns below which verdicts are shown alone, and without the properties' meanings."""

PIPE_COLUMNS = 1000
"""Columns a table may take where no terminal shows it."""


def print_json(document: Mapping[str, Any]) -> None:
    """Print one JSON document on stdout; numbers that JSON has no word for become null."""
    json.dump(_plain(document), sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value


def add_config_arguments(parser: argparse.ArgumentParser) -> None:
    """Add CONFIG and --set, which several commands share."""
    parser.add_argument("config", nargs="?", metavar="CONFIG",
                        help="a configuration file, or a folder with config.yaml "
                        "(default: ./config.yaml)")
    add_set_argument(parser)


def add_set_argument(parser: argparse.ArgumentParser) -> None:
    """Add --set."""
    parser.add_argument("--set", action="append", default=[], dest="overrides",
                        metavar="NAME=VALUE",
                        help="override a key of the configuration, such as load=3 or "
                        "plant.time_scale=100; may be given several times")


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --scenario and --fault, which the commands with a plant share."""
    parser.add_argument("--scenario", action="append", default=[], dest="scenarios",
                        metavar="FILE", type=Path,
                        help="faults and tag writes at set instants (docs/scenarios.md); may be "
                        "given several times")
    parser.add_argument("--fault", action="append", default=[], dest="faults", metavar="TEXT",
                        help="a fault of the plant, such as 'V8 stuck at 100s' or 'B3 leak 0.02 "
                        "at 5min until 10min'; may be given several times")


def scenario_of(arguments: argparse.Namespace) -> Scenario:
    """Return what the scenario arguments say.

    Raises:
        ConfigError: a file or fault is wrong.
    """
    parts = [load_scenario(path) for path in arguments.scenarios]
    return sum([*parts, *(parse_fault(text) for text in arguments.faults)], Scenario())


def duration(text: str) -> int:
    """Read a duration argument as ns; not negative."""
    try:
        t_ns = parse_duration_ns(text)
    except DurationError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None
    if t_ns < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is negative")
    return t_ns


def console(to_stderr: bool = False) -> Console:
    """Return a console that shows texts as they are; in a file or pipe, lines are not squeezed."""
    from rich.console import Console

    made = Console(stderr=to_stderr, highlight=False, markup=False, emoji=False)
    if not made.is_terminal:
        made.width = PIPE_COLUMNS
    return made


def show_warnings(warnings: Sequence[Diagnostic]) -> None:
    """Print a program's warnings on stderr."""
    for warning in warnings[:LIMITED]:
        print(warning, file=sys.stderr)
    if len(warnings) > LIMITED:
        print(f"... and {len(warnings) - LIMITED} more warnings; `plcemu check` shows all",
              file=sys.stderr)


def add_log_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the log."""
    parser.add_argument("--log-format", choices=("text", "json"), default="text",
                        help="log lines for people, or one JSON object a line (default: text)")
    parser.add_argument("--log-level", choices=("debug", "info", "warning", "error"),
                        help="the least important log lines shown (default: info)")
    parser.add_argument("--verbose", action="store_true", help="the same as --log-level debug")


class JsonLines(logging.Formatter):
    """One JSON object a line: `time` (ISO 8601, UTC), `level`, `logger`, `message`."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record as a line."""
        at = datetime.datetime.fromtimestamp(record.created, datetime.UTC)
        entry = {"time": at.isoformat(timespec="milliseconds"), "level": record.levelname.lower(),
                 "logger": record.name, "message": record.getMessage()}
        if record.exc_info:
            entry["exception"] = self.formatException(record.exc_info)
        return json.dumps(entry)


def set_up_log(arguments: argparse.Namespace) -> None:
    """Send log lines to stderr as the options of `add_log_arguments` ask for."""
    level = "debug" if arguments.verbose else "info"
    set_up_logging((arguments.log_level or level).upper(), arguments.log_format == "json")


def set_up_logging(level: str = "INFO", as_json: bool = False) -> None:
    """Send log lines to stderr, one an event."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines() if as_json else logging.Formatter(
        "%(asctime)s %(levelname)-7s %(name)s: %(message)s"))
    logging.basicConfig(level=level, handlers=[handler], force=True)
    logging.getLogger("asyncio").setLevel(logging.WARNING)
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


def properties_table(properties: Sequence[Mapping[str, Any]], columns: int,
                     brief: bool = False) -> Table:
    """Return the verdicts as a table that fits a width in columns.

    A brief one has one line for each property, without its meaning; so has a narrow one.
    """
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    shown = 2 if columns < NARROW[0] else 4 if brief or columns < NARROW[1] else 5
    headings = ("property", "verdict", "triggers", "decided at", "meaning")[:shown]
    for heading in headings:
        table.add_column(heading, justify="right" if heading == "triggers" else "left",
                         no_wrap=heading != "meaning", overflow="fold")
    styles = {"violated": "bold red", "presumably violated": "yellow", "inconclusive": "yellow"}
    for entry in properties:
        decided = entry["decided_at_s"]
        vacuous = " (vacuous)" if entry.get("vacuous") else ""
        cells = (entry["name"], entry["verdict"] + vacuous, str(entry["triggers"]),
                 "" if decided is None else f"{decided:g} s", entry.get("description", ""))
        table.add_row(*cells[:len(headings)], style=styles.get(entry["verdict"], ""))
    return table


def print_report(report: Mapping[str, Any]) -> None:
    """Print a run's report for people."""
    out = console()
    name = report["name"] or "PLC"
    out.print(f"{name}: {report['state']} at {report['t_s']:g} s, {report['scans']} scans, "
              f"{report['overruns']} overruns")
    if "fault" in report:
        out.print(f"FAULT: {report['fault']}", style="bold red")
    if report["properties"]:
        out.print(properties_table(report["properties"], out.width))
        for entry in report["properties"]:
            _print_violation(out, entry)
    for alarm in report.get("alarms", ()):
        if alarm["state"] != "normal":
            out.print(f"alarm {alarm['name']} ({alarm['severity']}): {alarm['state']}, raised at "
                      f"{alarm['raised_s']:g} s: {alarm['text']}")
    for line in _plant_lines(report.get("plant") or {}):
        out.print(line)


def _print_violation(out: Console, entry: Mapping[str, Any]) -> None:
    story = entry.get("violation")
    if not story:
        return
    out.print(f"\n{entry['name']} is violated: {entry['formula']}", style="bold red")
    trigger = story.get("trigger_s")
    since = f", triggered at {trigger:g} s" if trigger is not None else ""
    out.print(f"  decided at {story['decided_at_s']:g} s{since}; to blame: " +
              ", ".join(f"{tag} = {value}" for tag, value in story["blamed"].items()))
    if entry.get("meaning"):
        out.print(f"  meaning: {entry['meaning']}")
    for line in story["table"].splitlines():
        out.print(f"  {line}", no_wrap=True, overflow="ignore", crop=False)


def print_stories(out: Console, properties: Sequence[Mapping[str, Any]]) -> None:
    """Tell what became of the properties that did not hold, or of which nobody can tell."""
    for entry in properties:
        _print_violation(out, entry)
        if entry["reason"]:
            out.print(f"\n{entry['name']} is inconclusive: {entry['reason']}")


def _plant_lines(plant: Mapping[str, Any]) -> list[str]:
    lines = []
    if "batches" in plant:
        period = plant.get("period_s")
        long_run = f", {period:.1f} s a batch in the long run" if period is not None else ""
        lines.append(f"plant: {plant['batches']} batches{long_run}")
    if plant.get("reason"):
        still = "stands still" if plant.get("batches") else "produces nothing"
        what = still if plant.get("stuck") else "no batch so far"
        lines.append(f"plant: {what}: {plant['reason']}")
    return lines


def failed(report: Mapping[str, Any]) -> bool:
    """Whether a run's report holds a failed verdict or a fault."""
    return report["state"] == "FAULT" or any(p["verdict"] == "violated"
                                             for p in report["properties"])
