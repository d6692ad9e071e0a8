"""The machine: memory, engines, tasks and the resource. Knows the IR; no language, clock or I/O."""
