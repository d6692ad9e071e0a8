"""WebAssembly text, line by line: what is left out, and how it is indented."""

from __future__ import annotations

_GET, _TEE, _SET = "local.get $", "local.tee $", "local.set $"
_PADS = tuple("  " * depth for depth in range(21))


def without_unread_copies(lines: list[str]) -> list[str]:
    """Leave out the copies of cells that nobody reads; their names have a `+`."""
    read = {line[10:] for line in lines if line[:11] == _GET}
    return [line for line in lines
            if line[:11] != _TEE or "+" not in line or line[10:] in read]


def temporaries(lines: list[str]) -> list[str]:
    """Return the declarations of temporaries, whose names begin with their types: `$i32.0`."""
    written = {line.split(" ")[1] for line in lines if line[:11] in (_TEE, _SET)}
    return [f"  (local {name} {name[1:4]})" for name in sorted(written) if not name[1].isdigit()]


def indented(lines: list[str]) -> list[str]:
    """Indent what stands in blocks, loops and ifs."""
    out, depth = [], 1
    for line in lines:
        if line[:3] == "end":
            depth -= 1
        out.append(_PADS[min(depth, 20)] + line)
        if line == "if" or line[:6] == "block " or line[:5] == "loop ":
            depth += 1
    return out
