"""The diagnostics of the property language: one row a code, stable once published."""

from __future__ import annotations

from plcemu.base.spans import Diagnostic, Span

CODES: dict[str, str] = {
    "M0001": "found {found}, expected {expected}",
    "M0002": "{found} is no character of the property language",
    "M0003": "{found} is not a duration",
    "M0004": "the interval {found} holds no instant",
    "M0005": "the operator {found} takes no interval",
    "M0006": "there are two properties {found}",
    "M0007": "cannot read the file: {found}",
    "M0010": "{found}",
    "M0011": "{found} is a {kind}, expected a {expected}",
    "M0012": "{found} stands in ago, expected {expected}",
    "M0020": "{found} speaks of other runs",
    "M0021": "{found} cannot be judged online",
    "M0022": "{found} stands inside a comparison, arithmetic or rise, fall, changed, previous, ago",
}
"""Code to message; the names in braces are filled in by the finder."""


def diagnostic(code: str, span: Span, hint: str = "", **parts: str) -> Diagnostic:
    """Return the finding with its message filled in."""
    return Diagnostic(code, span, CODES[code].format(**parts), hint)
