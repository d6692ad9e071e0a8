"""PLC, plant and clients as real processes over real TCP."""

from __future__ import annotations

import random
import signal
import socket
import struct
from pathlib import Path
from typing import Any

import pytest
from processes import Command, modbus_client, until
from systems import BATCH, write_config

pytestmark = pytest.mark.acceptance

FAST = ("--set", "cycle=10ms", "--set", "time_scale=150")


B4_LEVEL = 3
"""The input register of B4's level."""


def daemon(*arguments: str) -> Command:
    return Command("run", BATCH, "--no-plant", "--json", "--set", "port=0", *FAST, *arguments)


def plant(port: int, folder: Path, *arguments: str) -> Command:
    return Command("plant", BATCH, "--connect", f"127.0.0.1:{port}", "--json", "--state",
                   folder / "state.json", *FAST, *arguments)


def batches(client: Any) -> int:
    """Return what the PLC's program has counted."""
    count: int = client.read_holding_registers(0).registers[0]
    return count


def test_plc_and_plant_as_two_processes_make_batches(tmp_path: Path) -> None:
    with daemon() as plc, plant(plc.port, tmp_path) as field, modbus_client(plc.port) as client:
        until(lambda: batches(client) >= 1, "a batch")
        until(lambda: client.read_input_registers(B4_LEVEL, count=1).registers[0] > 0,
              "the batch to arrive in B4")
        field_code, field_report = field.stop(signal.SIGINT)
        code, report = plc.stop()
    assert (code, field_code) == (0, 0)
    assert field_report["plant"]["batches"] >= 1 and field_report["outages"] == 0
    assert report["state"] == "STOP" and report["scans"] > 100
    assert not [p for p in report["properties"] if p["verdict"] == "violated"]
    assert "no_overflow" in report["not_judged"]


def test_a_plant_that_meets_a_plc_started_anew_starts_anew_too(tmp_path: Path) -> None:
    with daemon() as plc, modbus_client(plc.port) as client, plant(plc.port, tmp_path) as first:
        first.wait_for("connected")
        until(lambda: any(client.read_coils(1, count=35).bits), "a valve opens")
        first.kill()
        port = plc.port
    with daemon("--set", f"modbus.port={port}") as anew, plant(anew.port, tmp_path) as second:
        second.wait_for("the PLC has started anew")
        assert second.wait_for(r"connected; the plant stands at ([\d.]+) s")[1] == "0.0"


def test_a_killed_plant_goes_on_where_it_was(tmp_path: Path) -> None:
    with daemon() as plc, modbus_client(plc.port) as client:
        with plant(plc.port, tmp_path) as first:
            first.wait_for("connected")
            until(lambda: any(client.read_coils(1, count=35).bits), "a valve opens")
            first.kill()
        with plant(plc.port, tmp_path) as second:
            second.wait_for("going on from the state of a plant that ended without notice")
            until(lambda: batches(client) >= 1, "a batch")
            second.stop()
        with plant(plc.port, tmp_path) as third:
            third.wait_for("going on from the state")
            stands = float(third.wait_for(r"connected; the plant stands at ([\d.]+) s")[1])
            code, report = third.stop(signal.SIGINT)
        assert stands > 100 and code == 0 and report["plant"]["batches"] >= 1
        with plant(plc.port, tmp_path) as fourth:
            assert float(fourth.wait_for(r"plant stands at ([\d.]+) s")[1]) < 100
        code, report = plc.stop()
    assert report["state"] == "STOP" and "fault" not in report
    # A plant that starts anew makes levels jump, which the monitors of broken equipment may tell.
    violated = [p["name"] for p in report["properties"] if p["verdict"] == "violated"]
    assert all(name.endswith(("_steady", "_ends")) for name in violated)
    assert code == int(bool(violated))


def test_a_plant_goes_on_through_an_outage_of_the_plc(tmp_path: Path) -> None:
    with daemon() as plc, plant(plc.port, tmp_path) as field:
        port = plc.port
        field.wait_for("connected")
        plc.kill()
        field.wait_for("connection lost")
        with daemon("--set", f"port={port}") as again:
            again.wait_for("listening")
            until(lambda: field.text.count("connected; ") == 2, "the plant connects again")
            code, report = field.stop(signal.SIGINT)
    assert (code, report["outages"]) == (0, 1)


NONSENSE = [
    b"GET / HTTP/1.1\r\n\r\n", b"\0" * 300, b"\xff" * 300,
    struct.pack(">HHHB", 1, 0, 65535, 1), struct.pack(">HHHB", 1, 0, 6, 1) + b"\x03\0",
    struct.pack(">HHHB", 1, 7, 6, 1) + bytes(5), struct.pack(">HHHBB", 1, 0, 2, 1, 0x63),
    (struct.pack(">HHHB", 1, 0, 6, 1) + bytes.fromhex("03 0000 007d")) * 2000,
    random.Random(4711).randbytes(5000),
]


def test_clients_that_send_nonsense_do_not_disturb_the_cycle(tmp_path: Path) -> None:
    with daemon() as plc, plant(plc.port, tmp_path) as field, modbus_client(plc.port) as client:
        field.wait_for("connected")
        peers = [socket.create_connection(("127.0.0.1", plc.port)) for _ in NONSENSE]
        for peer, data in zip(peers, NONSENSE, strict=True):
            peer.sendall(data)
        until(lambda: batches(client) >= 1, "a batch")
        for peer in peers:
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            peer.close()
        assert batches(client) >= 1
        code, report = plc.stop()
    assert code == 0 and report["state"] == "STOP" and "fault" not in report
    assert report["modbus"]["protocol_errors"] >= 3
    assert "Traceback" not in plc.text and "Traceback" not in field.text


def test_termination_brings_outputs_to_safe_values_that_clients_still_read(tmp_path: Path) -> None:
    write_config(tmp_path, "program: main.il\ncycle: 10ms\nmodbus: {port: 0}\n")
    with Command("run", tmp_path, "--json") as plc, modbus_client(plc.port) as client:
        client.write_register(16384 + 1, 1234)
        until(lambda: client.read_holding_registers(1).registers == [1234], "the output follows")
        plc.send(signal.SIGTERM)
        until(lambda: client.read_holding_registers(1).registers == [0], "the output is safe")
        code, report = plc.result()
    assert (code, report["state"], report["tags"]["MAIN.speed"]) == (0, "STOP", 0)
    assert "stopping: SIGTERM" in plc.text


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_long_cycle_does_not_delay_the_end(tmp_path: Path, number: signal.Signals) -> None:
    write_config(tmp_path, "program: main.il\ncycle: 1h\nmodbus: {port: 0}\n")
    with Command("run", tmp_path, "--json") as plc:
        assert plc.port
        code, report = plc.stop(number)
    assert (code, report["scans"]) == (0, 1)
    assert report["t_s"] < 60


def test_the_daemon_keeps_its_cycle(tmp_path: Path) -> None:
    with daemon("--for", "3s") as plc, plant(plc.port, tmp_path) as field:
        field.wait_for("connected")
        code, report = plc.result()
    assert code == 0 and report["t_s"] == 3.0
    assert report["scans"] + report["missed"] == 300
    assert report["scans"] > 200


def test_a_local_plant_steps_aside_for_one_that_connects(tmp_path: Path) -> None:
    with Command("run", BATCH, "--json", "--set", "port=0", *FAST) as plc, \
            plant(plc.port, tmp_path, "--set", "load=5") as field:
        plc.wait_for("the plant in this process steps aside")
        field.stop(signal.SIGINT)
        code, report = plc.stop()
    assert code in (0, 1) and report["state"] == "STOP"


def test_a_second_daemon_on_the_same_port_is_refused(tmp_path: Path) -> None:
    with daemon() as plc:
        with Command("run", BATCH, "--set", f"port={plc.port}") as second:
            code, _ = second.result()
        assert code == 2
        assert f"cannot listen on 127.0.0.1:{plc.port}: address already in use" in second.text
        assert "Traceback" not in second.text
        assert plc.is_running


def test_a_plant_at_something_that_is_no_plc_says_so_once(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent, \
            plant(silent.getsockname()[1], tmp_path, "--for", "3s") as field:
        code, report = field.result()
    assert (code, report["steps"]) == (0, 0)
    assert field.text.count("WARNING") == 1 and "Traceback" not in field.text


def test_the_same_run_in_two_processes_writes_the_same_bytes(tmp_path: Path) -> None:
    for seed in ("0", "1", "4711"):
        for ending in ("csv", "jsonl", "vcd"):
            with Command("simulate", BATCH, "--until", "900s", "--set", "load=3", "--set",
                         "cycle=100ms", "--trace", tmp_path / f"{seed}.{ending}",
                         PYTHONHASHSEED=seed) as simulation:
                assert simulation.code() == 0
    for ending in ("csv", "jsonl", "vcd"):
        written = {(tmp_path / f"{seed}.{ending}").read_bytes() for seed in ("0", "1", "4711")}
        assert len(written) == 1 and len(written.pop()) > 1000
