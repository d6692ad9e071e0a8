"""What can be said of the whole program only: recursion, and what is likely a mistake."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from plcemu.ir.program import Function, Task
from plcemu.lang import syntax as s
from plcemu.lang.report import Report
from plcemu.lang.scope import Scope
from plcemu.lang.types import ArrayType, BlockType, Place, Type


def _calls(function: Function) -> list[str]:
    return list(dict.fromkeys(i.arg for i in function.code if i.op == "call"))


def reachable(functions: Mapping[str, Function], roots: Iterable[str]) -> set[str]:
    """Return the functions that are called from the roots, with these themselves."""
    found: set[str] = set()
    pending = list(roots)
    while pending:
        name = pending.pop()
        if name not in found:
            found.add(name)
            pending += _calls(functions[name])
    return found


def report_recursion(functions: Mapping[str, Function], scopes: Iterable[Scope],
                     report: Report) -> None:
    """Report every POU that calls itself, perhaps by way of others (IEC 61131-3, 2.5, rule 1).

    A circle of POUs is one mistake, reported at the one that is declared first.
    """
    order = {scope.pou.name.upper(): n for n, scope in enumerate(scopes)}
    pous = {scope.pou.name.upper(): scope.pou for scope in scopes}
    for circle in _circles({name: [c for c in _calls(f) if c in functions]
                            for name, f in functions.items()}):
        names = [name for name in circle if name in order]
        first = min(names, key=order.__getitem__, default=None)
        if first is None:
            continue
        at = names.index(first)
        chain = " calls ".join(pous[name].name for name in [*names[at:], *names[:at], first])
        report.error("P0060", pous[first].span, f"{pous[first].name} calls itself: {chain}")


def _circles(calls: Mapping[str, list[str]]) -> Iterator[list[str]]:
    """Yield a circle for every call that leads back to a function it came from."""
    done: set[str] = set()
    for start in calls:
        way: dict[str, Iterator[str]] = {} if start in done else {start: iter(calls[start])}
        while way:
            name = next(reversed(way))
            called = next(way[name], None)
            if called is None:
                del way[name]
                done.add(name)
            elif called in way:
                names = list(way)
                yield names[names.index(called):]
            elif called not in done:
                way[called] = iter(calls[called])


# ---------------------------------------------------------------- warnings


def warn(scopes: Sequence[Scope], shared: Scope, report: Report) -> None:
    """Warn of what compiles but is likely a mistake.

    Args:
        scopes: of the user's POUs.
        shared: the global variables.
        report: takes the warnings.
    """
    written = {key for scope in scopes for key in scope.written if key[0] == "memory"}
    called = {key for scope in scopes for key in scope.called if key[0] == "memory"}
    for scope in scopes:
        _warn_of_unused(scope, report)
        _warn_of_result(scope, report)
        _warn_of_variables(scope, written | scope.written, called | scope.called, report)
    _warn_of_variables(shared, written, called, report)


def _warn_of_unused(scope: Scope, report: Report) -> None:
    for variable in scope.unused.values():
        report.warning("P0070", variable.span, f"variable {variable.name!r} is never used")


def _warn_of_result(scope: Scope, report: Report) -> None:
    pou = scope.pou
    if pou.kind != "FUNCTION":
        return
    place = scope.places[pou.name.upper()]
    if (place.base, place.offset) not in scope.written:
        hint = f"ST {pou.name} gives it one" if isinstance(pou.body, s.IlBody) else ""
        report.warning("P0073", pou.span, f"the function {pou.name} never gets a value", hint)


def _declared(scope: Scope) -> Iterator[tuple[s.Variable, Place]]:
    for variable in scope.pou.variables:
        place = scope.places.get(variable.name.upper())
        if variable.section != "VAR_EXTERNAL" and place is not None and place.base != "unknown":
            yield variable, place


def _warn_of_variables(scope: Scope, written: set[tuple[str, int]],
                       called: set[tuple[str, int]], report: Report) -> None:
    for variable, place in _declared(scope):
        key = (place.base, place.offset)
        if variable.name.upper() in scope.unused:
            continue
        if key not in written and _is_output(variable):
            report.warning("P0071", variable.span, f"output {variable.name!r} is never written")
        elif key not in called and _is_instance(place.type) \
                and variable.section != "VAR_IN_OUT":
            report.warning("P0072", variable.span,
                           f"function block instance {variable.name!r} is never called")


def _is_output(variable: s.Variable) -> bool:
    """Whether only the program gives a variable its value, which has none of its own."""
    return variable.initial is None and not variable.constant and (
        variable.section == "VAR_OUTPUT" or variable.address.upper().startswith("%Q"))


def _is_instance(of: Type) -> bool:
    while isinstance(of, ArrayType):
        of = of.element
    return isinstance(of, BlockType) and of.kind == "FUNCTION_BLOCK"


def warn_of_tasks(tasks: Sequence[Task], programs: Mapping[str, str], scopes: Sequence[Scope],
                  shared: Scope, functions: Mapping[str, Function], report: Report) -> None:
    """Warn of global variables that programs of two tasks write.

    `programs` has the function that runs it for every program instance.
    """
    written = {scope.pou.name.upper(): scope.written for scope in scopes}
    writers: dict[tuple[str, int], list[str]] = {}
    for task in tasks:
        names = reachable(functions, (programs[name].upper() for name in task.programs))
        pous = {functions[name].pou.upper() for name in names}
        for key in set().union(*(written.get(pou, ()) for pou in pous)):
            writers.setdefault(key, []).append(task.name)
    for variable, place in _declared(shared):
        found = writers.get((place.base, place.offset), [])
        if len(found) > 1:
            report.warning("P0074", variable.span, f"variable {variable.name!r} is written by the "
                           f"tasks {' and '.join(sorted(found))}")
