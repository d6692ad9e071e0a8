"""SPLIT_DATE and its kin (3rd edition, table 36): functions that have outputs and no value.

A call becomes assignments, one for each output that it takes: SPLIT_DATE(IN := d, YEAR => y) is
y := __YEAR(d), of a function that is not for users.
"""

from __future__ import annotations

from plcemu.lang import syntax as s
from plcemu.lang.report import Report

_DAY = ("YEAR", "MONTH", "DAY")
_CLOCK = ("HOUR", "MINUTE", "SECOND", "MILLISECOND")
SPLITS: dict[str, tuple[str, ...]] = {
    "SPLIT_DATE": _DAY, "SPLIT_TOD": _CLOCK, "SPLIT_LTOD": _CLOCK,
    "SPLIT_DT": _DAY + _CLOCK, "SPLIT_LDT": _DAY + _CLOCK}
"""The outputs of each, in order; its input is IN."""


def split_assignments(call: s.Call, report: Report) -> list[s.Assign] | None:
    """Return the assignments that a call stands for; None if it is another function's.

    Mistakes go to the report.
    """
    outputs = SPLITS.get(call.name.upper())
    if outputs is None:
        return None
    arguments = call.arguments
    if arguments and not any(a.name for a in arguments):
        arguments = tuple(s.Argument(a.span, name, a.value, name != "IN")
                          for a, name in zip(arguments, ("IN", *outputs), strict=False))
    source = [a.value for a in arguments if a.name.upper() == "IN" and not a.is_output]
    if len(source) != 1 or len(arguments) != len(call.arguments):
        report.error("P0026", call.span, f"{call.name} takes IN and gives {', '.join(outputs)}")
        return []
    made: list[s.Assign] = []
    for each in arguments:
        if each.value is source[0]:
            continue
        if not each.is_output or each.negated or each.name.upper() not in outputs:
            report.error("P0026", each.span, f"{call.name} has no output {each.name!r}",
                         f"its outputs are {', '.join(outputs)}")
        elif not isinstance(each.value, s.Name | s.Direct):
            report.error("P0024", each.value.span, "an output goes into a variable")
        else:
            argument = s.Argument(call.span, "", source[0])
            of = s.Call(call.span, f"__{each.name.upper()}", (argument,))
            made.append(s.Assign(each.span, each.value, of))
    return made
