"""The garbage collector, paused while much is built that all stays.

Compiling makes trees without cycles: collecting in between finds nothing, and looks at everything
made so far again and again, so that its time grows faster than the text.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def paused_collector() -> Iterator[None]:
    """Pause cyclic garbage collection; as a decorator, during every call."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
