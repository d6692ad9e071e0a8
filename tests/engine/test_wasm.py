"""The WebAssembly engine: its two ways to call, lifetimes, traps, text, and where it lacks."""

import gc
import logging
import struct
import sys

import pytest
from engines_compared import numbered, outcome, program_of

from plcemu.base.errors import LimitError, PlcemuError, ProgramFault
from plcemu.engine import engines, native
from plcemu.engine.engines import make_engine
from plcemu.engine.wasm import WasmEngine
from plcemu.engine.wat import RUN_ROOM, translate_program
from plcemu.ir.program import Function, Instr
from plcemu.lang.compile import compile_program

COUNTER = """PROGRAM MAIN VAR n, d : INT := 1; r : REAL; s : STRING[8]; t : TON; END_VAR
n := n + 1; r := SIN(r) + 1.0; s := CONCAT(s, 'x'); t(IN := TRUE, PT := T#1s);
IF n > 3 THEN n := n / (d - 1); END_IF; END_PROGRAM"""
MAIN = [("MAIN", 0)]
RET = Instr("ret")


@pytest.fixture(params=[True, False], ids=["direct", "public"])
def engine(request):
    return WasmEngine(compile_program(COUNTER), direct=request.param)


def test_both_ways_to_call_do_what_the_interpreter_does(engine):
    oracle = make_engine("interpreter", compile_program(COUNTER))
    for code in (engine.prepare(MAIN), oracle.prepare(MAIN)):
        code.repeat(2, 300_000_000)
        with pytest.raises(ProgramFault, match=r"division by zero in MAIN at <text>:3:") as fault:
            code.repeat(5, 300_000_000)
        assert (code.completed, fault.value.reason) == (0, "division by zero")
    assert bytes(engine.block) == bytes(oracle.block)
    assert engine.clocks_run() == oracle.clocks_run() is True


def test_after_a_fault_the_code_runs_on(engine):
    code, places = engine.prepare(MAIN), {s.tag.name: s.offset
                                          for s in compile_program(COUNTER).layout.slots}
    for _ in range(50):
        engine.block[places["MAIN.n"]] = 3
        with pytest.raises(ProgramFault):
            code.run()
        engine.block[places["MAIN.d"]] = 2
        code.run()
        engine.block[places["MAIN.d"]] = 1


def test_what_is_no_fault_of_the_program_is_raised_as_it_is(engine, monkeypatch):
    def interrupted(*operands):
        raise KeyboardInterrupt
    hosts = engine._translated.hosts
    assert "string.concat.s" in hosts
    monkeypatch.setattr("plcemu.ir.builtins.read_string", interrupted)
    with pytest.raises(KeyboardInterrupt):
        engine.run("MAIN", 0)


def test_the_direct_calls_exist_in_this_wasmtime():
    assert native.has_direct_calls()


def test_without_the_private_names_the_public_calls_serve(monkeypatch):
    monkeypatch.setattr(native, "_NAMES", (*native._NAMES, "no_longer_there"))
    assert not native.has_direct_calls()
    engine = WasmEngine(compile_program(COUNTER))
    engine.run("MAIN", 0)
    assert isinstance(engine._machine._ways, native._Public)


def test_the_memory_outlives_its_engine(engine):
    block, code = engine.block, engine.prepare(MAIN)
    del engine
    gc.collect()
    code.run()
    before = bytes(block)
    del code
    gc.collect()
    assert bytes(block) == before


def test_engines_that_nobody_holds_are_freed():
    program = compile_program(COUNTER)
    made = [WasmEngine(program, direct=d) for d in (True, False)]
    for engine in made:
        engine.run("MAIN", 0)
    gc.collect()
    before = sum(isinstance(o, native.Machine) for o in gc.get_objects())
    del engine, made
    gc.collect()
    assert sum(isinstance(o, native.Machine) for o in gc.get_objects()) == before - 2


def test_forks_share_the_machine_code_but_not_the_memory():
    program = compile_program(COUNTER)
    one, other = make_engine("wasm", program), make_engine("wasm", program)
    one.run("MAIN", 0)
    assert one._translated is other._translated
    assert bytes(other.block) == program.layout.initial != bytes(one.block)


@pytest.mark.parametrize("name", ["wasm", "interpreter"])
def test_many_runs_in_one_call_say_how_many_were_whole(name):
    engine = make_engine(name, compile_program(COUNTER))
    code = engine.prepare(MAIN)
    with pytest.raises(ProgramFault):
        code.repeat(100, 0)
    assert code.completed == 2
    code.repeat(0, 5)
    assert code.completed == 0


@pytest.mark.parametrize("name", ["wasm", "interpreter"])
def test_a_budget_is_for_all_of_a_tasks_instances_together_and_may_change(name):
    text = "PROGRAM MAIN VAR i : INT; END_VAR FOR i := 1 TO 10 DO ; END_FOR; END_PROGRAM"
    engine = make_engine(name, compile_program(text))
    one, two = engine.prepare(MAIN), engine.prepare(MAIN * 2)
    enough = next(b for b in range(1000) if fits(one, b))
    assert (fits(two, enough), fits(two, 2 * enough)) == (False, True)


def fits(code, budget):
    code.budget = budget
    try:
        code.run()
    except ProgramFault as fault:
        assert f"cost over {budget} instructions" in fault.reason
        return False
    return True


@pytest.mark.parametrize("name", ["wasm", "interpreter"])
@pytest.mark.parametrize("code", [
    [Instr("loadat", ("i32", 0)), Instr("drop")], [Instr("loadat", ("bool", 0)), Instr("drop")],
    [Instr("const", ("f64", 1.0)), Instr("storeat", ("f64", 0))],
    [Instr("addr", ("memory", 0)), Instr("copy", 8)],
    [Instr("const", ("i64", 1)), Instr("const", ("i64", 7)),
     Instr("builtin", "string.of.i64.s")]], ids=lambda code: code[-1].op)
@pytest.mark.parametrize("address", [64, 70, 65536, 2**32 - 4])
def test_an_address_that_damage_put_outside_memory_is_a_fault(name, code, address):
    image = struct.pack("<I", address).ljust(64, b"\7")
    function = Function("F", numbered([Instr("load", ("u32", "memory", 0)), *code, RET]), (), "",
                        "P")
    engine = make_engine(name, program_of([function], image))
    assert outcome(engine, "F")[0] == "an address outside memory"
    assert bytes(engine.block) == image


def test_so_many_lists_of_instances_have_no_room():
    engine = make_engine("wasm", compile_program(COUNTER))
    with pytest.raises(LimitError, match="more than 4096 program instances"):
        engine.prepare(MAIN * (RUN_ROOM // 8 + 1))


def test_a_program_runs_only_where_it_has_an_instance():
    with pytest.raises(ValueError, match="MAIN has no instance at 8"):
        make_engine("wasm", compile_program(COUNTER)).run("MAIN", 8)


# ---------------------------------------------------------------- where wasmtime is missing


@pytest.fixture
def without_wasmtime(monkeypatch):
    monkeypatch.setitem(sys.modules, "wasmtime", None)
    for name in ("plcemu.engine.wasm", "plcemu.engine.native"):
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(engines, "_said", set())


def test_without_wasmtime_auto_is_the_interpreter_and_says_so_once(without_wasmtime, caplog):
    program = compile_program(COUNTER)
    with caplog.at_level(logging.WARNING):
        assert [make_engine("auto", program).name for _ in range(3)] == ["interpreter"] * 3
    assert [r.message for r in caplog.records if "interpreter" in r.message] == [
        caplog.records[0].message]
    assert "wasmtime" in caplog.text


def test_without_wasmtime_asking_for_it_is_an_error_that_says_what_to_do(without_wasmtime):
    with pytest.raises(PlcemuError, match=r"needs the package wasmtime.*choose 'auto'"):
        make_engine("wasm", compile_program(COUNTER))


def test_with_wasmtime_auto_is_the_fast_engine():
    assert make_engine("auto", compile_program(COUNTER)).name == "wasm"


# ---------------------------------------------------------------- the text


def test_the_text_tells_the_source_and_the_names():
    text = translate_program(compile_program(
        "PROGRAM MAIN\nVAR a, b : BOOL; END_VAR\nLD a\nJMPC over\nST b\nover:\nLD b\nST a\n"
        "END_PROGRAM")).text
    assert "(func $pou.MAIN" in text
    assert ";; <text>:3: LD a" in text
    assert "br_if $L" in text


def test_jumps_forwards_need_no_dispatcher():
    text = translate_program(compile_program(
        "PROGRAM MAIN VAR a : BOOL; END_VAR\nLD a\nJMPC one\nJMPCN two\none:\nLDN a\nJMPC two\n"
        "ST a\ntwo:\nLD a\nST a\nEND_PROGRAM")).text
    assert "$dispatch" not in text


def test_a_jump_into_a_loop_is_dispatched():
    body = ("LD a\nJMPC inside\nagain:\nLD n\nADD 1\nST n\ninside:\nLD n\nADD 10\nST n\nLT 50\n"
            "JMPC again")
    program = compile_program(f"PROGRAM MAIN VAR a : BOOL := TRUE; n : INT; END_VAR\n{body}\n"
                              "END_PROGRAM")
    assert "$dispatch" in translate_program(program).text
    found = []
    for name in ("wasm", "interpreter"):
        engine = make_engine(name, program)
        engine.run("MAIN", 0)
        found.append(bytes(engine.block))
    assert found[0] == found[1]
