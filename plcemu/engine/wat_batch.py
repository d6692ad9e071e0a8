"""The WebAssembly function that runs a program on many copies of its memory, one after another.

A record is a copy of the memory block up to a whole word, the inputs to be written into it, and
room for the bytes that are watched. The function copies it in, writes the inputs, lets time pass,
runs the program, and puts memory back into the record, where bytes that do not matter get their
initial values, and the watched bytes behind it.

What it must know of a batch are seven numbers of four bytes, `JOB`.
"""

from __future__ import annotations

import struct

JOB = struct.Struct("<7I")
"""How long a record is; where in it the watched bytes begin; the addresses of the mask of bytes
that matter and of the others' values; the list of inputs from its beginning to its end, each an
address in the block and a length; the end of the list of watched bytes, each an address in the
block, which begins where the other ends."""

COMPLETED = 0
"""Address of the number of whole runs made (i64)."""

WORD = 8
"""Bytes that masks are applied to at once."""


def whole_words(size: int) -> int:
    """Return the bytes that a copy of the block takes in a record, mask or rest."""
    return -(-size // WORD) * WORD


def each(origin: int, size: int) -> str:
    """Return the function that runs the program on each record of a batch.

    Args:
        origin: address of the memory block.
        size: of the block in bytes.
    """
    whole = whole_words(size)
    return f"""\
(func (export "each")
  (param $runs i64) (param $end i64) (param $count i64) (param $elapsed i64) (param $limit i64)
  (param $batch i64) (param $first i64)
  (local $job i32) (local $record i32) (local $at i32) (local $last i32) (local $data i32)
  (i64.store (i32.const {COMPLETED}) (i64.const 0))
  (global.set $budget (local.get $limit))
  (local.set $job (i32.wrap_i64 (local.get $batch)))
  (local.set $record (i32.wrap_i64 (local.get $first)))
  block $done
    loop $again
      (br_if $done (i64.eqz (local.get $count)))
      (memory.copy (i32.const {origin}) (local.get $record) (i32.const {size}))
      (local.set $data (i32.add (local.get $record) (i32.const {whole})))
      (local.set $at (i32.load offset=16 (local.get $job)))
      (local.set $last (i32.load offset=20 (local.get $job)))
      block $written
        loop $write
          (br_if $written (i32.ge_u (local.get $at) (local.get $last)))
          (memory.copy (i32.load (local.get $at)) (local.get $data)
            (i32.load offset=4 (local.get $at)))
          (local.set $data (i32.add (local.get $data) (i32.load offset=4 (local.get $at))))
          (local.set $at (i32.add (local.get $at) (i32.const 8)))
          br $write
        end
      end
      (if (i64.ne (local.get $elapsed) (i64.const 0)) (then (call $advance (local.get $elapsed))))
      (call $run_all (local.get $runs) (local.get $end) (local.get $limit))
      (memory.copy (local.get $record) (i32.const {origin}) (i32.const {size}))
      (local.set $data (i32.const 0))
      block $reduced
        loop $reduce
          (br_if $reduced (i32.ge_u (local.get $data) (i32.const {whole})))
          (local.set $at (i32.add (local.get $record) (local.get $data)))
          (i64.store (local.get $at)
            (i64.or
              (i64.and (i64.load (local.get $at))
                (i64.load (i32.add (local.get $data) (i32.load offset=8 (local.get $job)))))
              (i64.load (i32.add (local.get $data) (i32.load offset=12 (local.get $job))))))
          (local.set $data (i32.add (local.get $data) (i32.const {WORD})))
          br $reduce
        end
      end
      (local.set $data (i32.add (local.get $record) (i32.load offset=4 (local.get $job))))
      (local.set $at (local.get $last))
      (local.set $last (i32.load offset=24 (local.get $job)))
      block $told
        loop $tell
          (br_if $told (i32.ge_u (local.get $at) (local.get $last)))
          (i32.store8 (local.get $data) (i32.load8_u (i32.load (local.get $at))))
          (local.set $data (i32.add (local.get $data) (i32.const 1)))
          (local.set $at (i32.add (local.get $at) (i32.const 4)))
          br $tell
        end
      end
      (i64.store (i32.const {COMPLETED})
        (i64.add (i64.load (i32.const {COMPLETED})) (i64.const 1)))
      (local.set $record (i32.add (local.get $record) (i32.load (local.get $job))))
      (local.set $count (i64.sub (local.get $count) (i64.const 1)))
      br $again
    end
  end)"""
