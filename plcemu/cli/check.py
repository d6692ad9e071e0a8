"""`plcemu check`: compile, and print every diagnostic."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from plcemu.base.errors import CompileError
from plcemu.base.spans import Diagnostic
from plcemu.cli.output import print_json
from plcemu.engine.wat import translate_program
from plcemu.ir.program import Program
from plcemu.ir.text import print_program
from plcemu.lang.compile import compile_program
from plcemu.lang.sipn_il import export_il

HELP = "compile program files and print every diagnostic as file:line:column: CODE message"
EPILOG = "All files are compiled together, as one program. Exit code 1 if there is an error."

PASSES = ("ir", "wat", "tags")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    parser.add_argument("files", nargs="+", metavar="FILE", type=Path, help="program text")
    parser.add_argument("--export", choices=("il",), metavar="il",
                        help="print the text with its Signal Interpreted Petri Nets written as "
                        "Instruction List")
    parser.add_argument("--single-firing", action="store_true",
                        help="let nets fire once in a scan, as sipn_single_firing in config.yaml")
    parser.add_argument("--dump", choices=PASSES, metavar="PASS",
                        help=f"print what a pass made: {', '.join(PASSES)}")


def execute(arguments: argparse.Namespace) -> int:
    """Compile, and return 0 unless there is an error."""
    program: Program | None = None
    diagnostics: list[Diagnostic] = []
    failure = 1
    try:
        program = compile_program(arguments.files, single_firing=arguments.single_firing)
        diagnostics = list(program.warnings)
        exported = export_il(arguments.files, single_firing=arguments.single_firing) \
            if arguments.export else ""
    except CompileError as error:
        program = None
        diagnostics, failure = error.diagnostics, 2 if error.is_unreadable else 1
    if arguments.json:
        document = {"ok": program is not None, "diagnostics": [d.as_json() for d in diagnostics]}
        if arguments.dump and program is not None:
            document["dump"] = _dump(program, arguments.dump)
        if arguments.export and program is not None:
            document["export"] = exported
        print_json(document)
        return 0 if program is not None else failure
    # With --dump or --export, stdout is theirs.
    out = sys.stderr if arguments.dump or arguments.export else sys.stdout
    for diagnostic in diagnostics:
        print(diagnostic, file=out)
    if program is None:
        return failure
    if arguments.export:
        sys.stdout.write(exported)
    elif arguments.dump:
        sys.stdout.write(_dump(program, arguments.dump))
    else:
        code = sum(len(f.code) for f in program.functions.values())
        print(f"ok: {', '.join(i.name for i in program.instances)} "
              f"({code} instructions, {program.layout.size} bytes of memory, "
              f"{len(program.layout.slots)} tags)")
    return 0


def _dump(program: Program, what: str) -> str:
    if what == "ir":
        return print_program(program)
    if what == "wat":
        return translate_program(program).text
    return "".join(f"{s.tag.name} {s.tag.type} {s.tag.address}".rstrip() + "\n"
                   for s in program.layout.slots)
