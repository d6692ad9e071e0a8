"""A resource under test: compile a text, scan it in virtual time, read and write its tags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from plcemu.base.errors import CompileError
from plcemu.engine.resource import Resource
from plcemu.ir.program import Program
from plcemu.lang.compile import compile_program

MS = 1_000_000


def main(variables: str, body: str) -> str:
    """Return the text of a PROGRAM named MAIN."""
    return f"PROGRAM MAIN\nVAR\n{variables}\nEND_VAR\n{body}\nEND_PROGRAM\n"


class Controller:
    """A resource that is scanned once a cycle; `t_ns` is the next release."""

    def __init__(self, program: str | Program, cycle_ns: int = 10 * MS, **options: Any) -> None:
        compiled = program if isinstance(program, Program) else compile_program(program)
        self.resource = Resource(compiled, cycle_ns, **options)
        self.cycle_ns = cycle_ns
        self.t_ns = 0

    def __getitem__(self, name: str) -> Any:
        memory = self.resource.memory
        return memory.read(memory.tags.find(name))

    def __setitem__(self, name: str, value: Any) -> None:
        memory = self.resource.memory
        offset, row = memory.place(memory.tags.find(name))
        memory.block[offset:offset + row.size] = row.pack(value)

    def scan(self, n: int = 1) -> Controller:
        """Execute n releases."""
        for _ in range(n):
            self.resource.scan(self.t_ns)
            self.t_ns += self.cycle_ns
        return self

    def diagram(self, inputs: Mapping[str, str], outputs: Sequence[str]) -> dict[str, str]:
        """Scan once a column of the inputs' lines, `_` FALSE and `-` TRUE; return such lines."""
        lines = dict.fromkeys(outputs, "")
        for column in zip(*inputs.values(), strict=True):
            for name, level in zip(inputs, column, strict=True):
                self[name] = level == "-"
            self.scan()
            for name in outputs:
                lines[name] += "-" if self[name] else "_"
        return lines

    def lines(self, scans: int, outputs: Sequence[str]) -> dict[str, str]:
        """Scan without inputs; return the outputs' lines."""
        lines = dict.fromkeys(outputs, "")
        for _ in range(scans):
            self.scan()
            for name in outputs:
                lines[name] += "-" if self[name] else "_"
        return lines

    def values(self, scans: int, name: str) -> list[Any]:
        """Return one tag's value after each of so many scans."""
        return [self.scan()[name] for _ in range(scans)]


def evaluate(variables: str, body: str, name: str, **values: Any) -> Any:
    """Run a program text once and return a tag."""
    controller = Controller(main(variables, body))
    for key, value in values.items():
        controller[key] = value
    return controller.scan()[name]


def findings(text: str) -> list[str]:
    """Return `line:column: CODE` of every diagnostic of a text, warnings too."""
    try:
        diagnostics = list(compile_program(text).warnings)
    except CompileError as error:
        diagnostics = error.diagnostics
    return [f"{str(d).split(': ')[0].removeprefix('<text>:')}: {d.code}" for d in diagnostics]
