"""The WebAssembly function that runs a program on many copies of its memory, one after another.

Copies of the memory block stand in the room for batches, each in a *slot*. An *order* is the
address of a slot and the inputs to be written. The function copies the slot into the block, writes
the inputs, lets time pass, runs the program, and puts memory back into the slot, where bytes that
do not matter get their initial values. Of each order it tells whether the slot has changed, and
some bytes of it.

What it must know of a batch are eight numbers of four bytes, `JOB`.
"""

from __future__ import annotations

import struct

JOB = struct.Struct("<8I")
"""How long an order is, and what is told of one; the addresses of the mask of bytes that matter, of
the others' values and of a scratch copy; the list of inputs from its beginning to its end, each an
address in the block and a length; the end of the list of told bytes, each an offset in the slot,
which begins where the other ends."""

COMPLETED = 0
"""Address of the number of whole runs made (i64)."""

WORD = 8
"""Bytes that masks are applied to at once."""


def whole_words(size: int) -> int:
    """Return the bytes that a copy of the block takes."""
    return -(-size // WORD) * WORD


def each(origin: int, size: int) -> str:
    """Return the function that carries out the orders of a batch.

    Args:
        origin: address of the memory block.
        size: of the block in bytes.
    """
    return f"""\
(func (export "each")
  (param $runs i64) (param $end i64) (param $count i64) (param $elapsed i64) (param $limit i64)
  (param $batch i64) (param $orders i64) (param $tell i64)
  (local $job i32) (local $order i32) (local $slot i32) (local $out i32)
  (local $at i32) (local $last i32) (local $data i32) (local $new i64) (local $changed i64)
  (i64.store (i32.const {COMPLETED}) (i64.const 0))
  (global.set $budget (local.get $limit))
  (local.set $job (i32.wrap_i64 (local.get $batch)))
  (local.set $order (i32.wrap_i64 (local.get $orders)))
  (local.set $out (i32.wrap_i64 (local.get $tell)))
  block $done
    loop $again
      (br_if $done (i64.eqz (local.get $count)))
      (local.set $slot (i32.load (local.get $order)))
      (memory.copy (i32.const {origin}) (local.get $slot) (i32.const {size}))
      (local.set $data (i32.add (local.get $order) (i32.const 4)))
      (local.set $at (i32.load offset=20 (local.get $job)))
      (local.set $last (i32.load offset=24 (local.get $job)))
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
      (memory.copy (i32.load offset=16 (local.get $job)) (i32.const {origin}) (i32.const {size}))
      (local.set $data (i32.const 0))
      (local.set $changed (i64.const 0))
      block $reduced
        loop $reduce
          (br_if $reduced (i32.ge_u (local.get $data) (i32.const {whole_words(size)})))
          (local.set $at (i32.add (local.get $slot) (local.get $data)))
          (local.set $new
            (i64.or
              (i64.and
                (i64.load (i32.add (local.get $data) (i32.load offset=16 (local.get $job))))
                (i64.load (i32.add (local.get $data) (i32.load offset=8 (local.get $job)))))
              (i64.load (i32.add (local.get $data) (i32.load offset=12 (local.get $job))))))
          (local.set $changed
            (i64.or (local.get $changed)
              (i64.xor (local.get $new) (i64.load (local.get $at)))))
          (i64.store (local.get $at) (local.get $new))
          (local.set $data (i32.add (local.get $data) (i32.const {WORD})))
          br $reduce
        end
      end
      (i32.store8 (local.get $out) (i64.ne (local.get $changed) (i64.const 0)))
      (local.set $data (i32.add (local.get $out) (i32.const 1)))
      (local.set $at (local.get $last))
      (local.set $last (i32.load offset=28 (local.get $job)))
      block $told
        loop $tell
          (br_if $told (i32.ge_u (local.get $at) (local.get $last)))
          (i32.store8 (local.get $data)
            (i32.load8_u (i32.add (local.get $slot) (i32.load (local.get $at)))))
          (local.set $data (i32.add (local.get $data) (i32.const 1)))
          (local.set $at (i32.add (local.get $at) (i32.const 4)))
          br $tell
        end
      end
      (i64.store (i32.const {COMPLETED})
        (i64.add (i64.load (i32.const {COMPLETED})) (i64.const 1)))
      (local.set $order (i32.add (local.get $order) (i32.load (local.get $job))))
      (local.set $out (i32.add (local.get $out) (i32.load offset=4 (local.get $job))))
      (local.set $count (i64.sub (local.get $count) (i64.const 1)))
      br $again
    end
  end)"""
