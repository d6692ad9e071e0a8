"""wasmtime, as the WebAssembly engine needs it: modules, one instance with its memory, fast calls.

wasmtime's public way to call a function costs some 13 us, and its public way to be called back as
much again. So both go to the C functions below it, through names the package does not promise; if
one of them is missing, the public ways serve.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Protocol

import wasmtime

from plcemu.engine.wat_ops import KINDS
from plcemu.ir.ops import STRUCT_CODES

try:
    from wasmtime import _ffi
except ImportError:
    _ffi = None  # type: ignore[assignment]

_SLOT = 16
"""Bytes of one argument or result in a direct call."""

_WIDE_CODES = {**STRUCT_CODES, "bool": "I", "i8": "i", "i16": "i", "u8": "I", "u16": "I"}
_PUBLIC_CODES = {"i32": "i", "i64": "q", "f32": "f", "f64": "d"}


@dataclass(frozen=True, slots=True)
class Host:
    """A Python function that WebAssembly code calls.

    Attributes:
        pops: machine types of its operands.
        pushes: machine type of its result, or empty.
        fn: takes and returns Python values; what it raises stops the code.
    """

    pops: tuple[str, ...]
    pushes: str
    fn: Callable[..., Any]


class Unavailable(Exception):
    """wasmtime finds no room here: it reserves 4 GiB of addresses, not of memory, for each."""


class Stopped(Exception):
    """The code stopped before its end.

    Attributes:
        cause: what a host function raised; None if the code itself did what it may not.
    """

    def __init__(self, cause: BaseException | None, text: str) -> None:
        self.cause = cause
        super().__init__(text)


@lru_cache(maxsize=1)
def _engine() -> wasmtime.Engine:
    config = wasmtime.Config()
    config.cranelift_opt_level = "speed"
    config.parallel_compilation = False  # it starts threads, and gains nothing at our sizes
    return wasmtime.Engine(config)


def assemble(text: str) -> wasmtime.Module:
    """Compile WebAssembly text to machine code."""
    return wasmtime.Module(_engine(), bytes(wasmtime.wat2wasm(text)))


class Machine:
    """One instance of a module, with its memory and its host functions.

    Args:
        module: exports a memory, `memory`, that never grows.
        hosts: the functions it imports, by name.
        direct: whether to use the fast calls where wasmtime has them.
    """

    def __init__(self, module: wasmtime.Module, hosts: Mapping[str, Host],
                 direct: bool = True) -> None:
        self._store = wasmtime.Store(_engine())
        self._causes: list[BaseException] = []
        self._ways = _Direct(self._store) if direct and has_direct_calls() else _Public(self._store)
        imports = [self._ways.host(hosts[entry.name or ""], self._causes)
                   for entry in module.imports]
        try:
            instance = wasmtime.Instance(self._store, module, imports)
        except wasmtime.WasmtimeError as problem:
            raise Unavailable(" ".join(str(problem).split())) from None
        self._exports = instance.exports(self._store)

    def memory(self, start: int, size: int, owning: bool = True) -> memoryview:
        """Return a view of the memory; an owning one keeps the machine alive."""
        memory = self._exports["memory"]
        assert isinstance(memory, wasmtime.Memory)
        address = ctypes.addressof(memory.data_ptr(self._store).contents)
        view = _bytes_type(size).from_address(address + start)
        if owning:
            view.machine = self
        return memoryview(view).cast("B")

    def entry(self, name: str, arguments: Sequence[int]) -> Entry:
        """Return an exported function that takes i64 and returns nothing, ready to be called."""
        function = self._exports[name]
        assert isinstance(function, wasmtime.Func)
        return self._ways.entry(function, arguments, self._causes)


class Entry(Protocol):
    """An exported function with its arguments, unsigned integers."""

    def set(self, index: int, value: int) -> None:
        """Change an argument."""

    def call(self) -> None:
        """Run it; raises `Stopped`."""


@lru_cache(maxsize=64)
def _bytes_type(size: int) -> Any:
    """Return a type of so many bytes whose values can have attributes."""
    return type("Bytes", (ctypes.c_ubyte * size,), {})


def _stopped(causes: list[BaseException], trap: BaseException) -> Stopped:
    cause = causes.pop() if causes else None
    causes.clear()
    code = trap.trap_code if isinstance(trap, wasmtime.Trap) else None
    return Stopped(cause, code.name if code else str(trap))


class _Public:
    """Calls by wasmtime's public API."""

    def __init__(self, store: wasmtime.Store) -> None:
        self._store = store

    def host(self, host: Host, causes: list[BaseException]) -> wasmtime.Func:
        kinds = [KINDS[m] for m in host.pops]
        taken = struct.Struct("<" + "".join(_PUBLIC_CODES[k] for k in kinds))
        given = struct.Struct("<" + "".join(_WIDE_CODES[m] for m in host.pops))
        result = host.pushes

        def run(*operands: Any) -> Any:
            try:
                value = host.fn(*given.unpack(taken.pack(*operands)))
            except BaseException as problem:
                causes.append(problem)
                raise
            if not result:
                return None
            packed = struct.pack("<" + _WIDE_CODES[result], value)
            return struct.unpack("<" + _PUBLIC_CODES[KINDS[result]], packed)[0]
        return wasmtime.Func(self._store, _signature(host), run)

    def entry(self, function: wasmtime.Func, arguments: Sequence[int],
              causes: list[BaseException]) -> Entry:
        return _PublicEntry(self._store, function, arguments, causes)


class _PublicEntry:
    def __init__(self, store: wasmtime.Store, function: wasmtime.Func, arguments: Sequence[int],
                 causes: list[BaseException]) -> None:
        self._store, self._function, self._causes = store, function, causes
        self._arguments = [_signed(a) for a in arguments]

    def set(self, index: int, value: int) -> None:
        self._arguments[index] = _signed(value)

    def call(self) -> None:
        try:
            self._function(self._store, *self._arguments)
        except BaseException as trap:
            if isinstance(trap, wasmtime.Trap | wasmtime.WasmtimeError) or self._causes:
                raise _stopped(self._causes, trap) from None
            raise


def _signed(value: int) -> int:
    return value - (1 << 64) if value >> 63 else value


def _signature(host: Host) -> wasmtime.FuncType:
    kinds = {name: getattr(wasmtime.ValType, name)() for name in _PUBLIC_CODES}
    results = [kinds[KINDS[host.pushes]]] if host.pushes else []
    return wasmtime.FuncType([kinds[KINDS[m]] for m in host.pops], results)


def has_direct_calls() -> bool:
    """Whether wasmtime has the names that the fast calls need."""
    return _ffi is not None and all(hasattr(_ffi, name) for name in _NAMES) \
        and hasattr(wasmtime.Store, "_context") and hasattr(wasmtime.Func, "_from_raw") \
        and hasattr(wasmtime.Trap, "_from_ptr") and hasattr(wasmtime.WasmtimeError, "_from_ptr")


_NAMES = ("dll", "wasmtime_func_new_unchecked", "wasmtime_func_unchecked_callback_t",
          "wasmtime_func_t", "wasmtime_trap_new", "wasm_trap_t", "wasmtime_error_t")


class _Direct:
    """Calls by the C functions; for the layout of values see wasmtime's `val.h`."""

    def __init__(self, store: wasmtime.Store) -> None:
        self._store = store
        self._callbacks: list[Any] = []  # C holds no reference to them

    def host(self, host: Host, causes: list[BaseException]) -> wasmtime.Func:
        padded = [f"{_WIDE_CODES[m]}{_SLOT - struct.calcsize(_WIDE_CODES[m])}x" for m in host.pops]
        taken = struct.Struct("<" + "".join(padded))
        given = struct.Struct("<" + _WIDE_CODES.get(host.pushes, ""))
        fn, result, text = host.fn, host.pushes, b"host function"

        def run(_env: object, _caller: object, values: Any, _count: int) -> int:
            try:
                at = ctypes.addressof(values.contents)
                value = fn(*taken.unpack(ctypes.string_at(at, taken.size)))
                if result:
                    ctypes.memmove(at, given.pack(value), given.size)
            except BaseException as problem:
                causes.append(problem)
                trap = _ffi.wasmtime_trap_new(ctypes.create_string_buffer(text), len(text))
                return ctypes.cast(trap, ctypes.c_void_p).value or 0
            return 0
        callback = _ffi.wasmtime_func_unchecked_callback_t(run)
        self._callbacks.append(callback)
        made, signature = _ffi.wasmtime_func_t(), _signature(host)
        _ffi.wasmtime_func_new_unchecked(
            self._store._context(), signature.ptr(), callback, None,
            ctypes.cast(0, ctypes.CFUNCTYPE(None, ctypes.c_void_p)), ctypes.byref(made))
        return wasmtime.Func._from_raw(made)

    def entry(self, function: wasmtime.Func, arguments: Sequence[int],
              causes: list[BaseException]) -> Entry:
        return _DirectEntry(self, self._store, function, arguments, causes)


_CALL = ctypes.CFUNCTYPE(ctypes.c_ssize_t)
"""Without declared arguments: they are made once, and converting them would take half the time."""


class _DirectEntry:
    def __init__(self, owner: _Direct, store: wasmtime.Store, function: wasmtime.Func,
                 arguments: Sequence[int], causes: list[BaseException]) -> None:
        self._kept = owner, store, function  # C holds no reference to them either
        self._causes = causes
        self._values = (ctypes.c_uint64 * (2 * len(arguments)))(
            *(part for value in arguments for part in (value, 0)))
        self._trap = ctypes.c_void_p()
        self._call = partial(
            ctypes.cast(_ffi.dll.wasmtime_func_call_unchecked, _CALL),
            ctypes.cast(store._context(), ctypes.c_void_p), ctypes.byref(function._func),
            ctypes.byref(self._values), ctypes.c_size_t(len(arguments)), ctypes.byref(self._trap))

    def set(self, index: int, value: int) -> None:
        self._values[2 * index] = value

    def call(self) -> None:
        error = self._call()
        if error or self._trap:
            raise self._failed(error)

    def _failed(self, error: int) -> Stopped:
        trap, self._trap.value = self._trap.value or 0, None
        # The objects own what C gave us, and free it.
        if error:
            found = ctypes.cast(error, ctypes.POINTER(_ffi.wasmtime_error_t))
            return _stopped(self._causes, wasmtime.WasmtimeError._from_ptr(found))
        pointer = ctypes.cast(trap, ctypes.POINTER(_ffi.wasm_trap_t))
        return _stopped(self._causes, wasmtime.Trap._from_ptr(pointer))
