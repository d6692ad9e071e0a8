"""`plcemu plant`: the soft plant alone, as a Modbus client of any PLC."""

from __future__ import annotations

import argparse
import asyncio
import logging
import signal
from pathlib import Path

from hil.modbus_plant import ModbusPlant
from plcemu.base.errors import ConfigError
from plcemu.cli.output import (
    add_log_arguments,
    add_scenario_arguments,
    add_set_argument,
    duration,
    print_json,
    scenario_of,
    set_up_log,
)
from plcemu.modbus.errors import UnmappedError
from plcemu.runtime.config import Config, load_config
from plcemu.runtime.remote_plant import RemotePlant, StateFile
from plcemu.runtime.scenario import refuse_tags
from plcemu.runtime.wiring import configured_scenario, make_coupling, make_map

HELP = "the soft plant alone, as a Modbus client of any PLC"
EPILOG = """The plant goes on through outages of the PLC. If it is killed or terminated, the next
start with the same configuration and the same run of the PLC goes on from the state it had; after
Ctrl-C, at the end of --for and with --fresh it starts anew.

example:
  plcemu plant il_programs/batch_plant --connect 127.0.0.1:5020 --set load=3"""

_LOG = logging.getLogger("plcemu.plant")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    parser.add_argument("config", metavar="CONFIG",
                        help="a configuration file, or a folder with config.yaml")
    add_set_argument(parser)
    add_scenario_arguments(parser)
    parser.add_argument("--connect", required=True, metavar="HOST:PORT", type=_address,
                        help="the PLC's Modbus TCP server")
    parser.add_argument("--unit", type=_unit, default=1, metavar="N",
                        help="the Modbus unit identifier to ask (default: 1)")
    parser.add_argument("--for", dest="duration", metavar="DURATION", type=duration,
                        help="stop after this much time")
    parser.add_argument("--fresh", action="store_true",
                        help="start anew, also if a killed plant left its state")
    parser.add_argument("--state", metavar="FILE", type=Path,
                        help="keep the state in this file (default: one in the temporary folder)")
    add_log_arguments(parser)


def _address(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    is_number = port.isdecimal() and port.isascii() and len(port) < 6
    if not (colon and host and is_number and 0 < int(port) < 65536):
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, such as 127.0.0.1:5020")
    return host.strip("[]"), int(port)


def _unit(text: str) -> int:
    if not (text.isdecimal() and text.isascii() and int(text) < 256):
        raise argparse.ArgumentTypeError(f"{text!r} is not a unit identifier, 0 to 255")
    return int(text)


def execute(arguments: argparse.Namespace) -> int:
    """Run the plant until stopped."""
    set_up_log(arguments)
    config = load_config(arguments.config, arguments.overrides)
    plant = _prepare(config, arguments)
    terminated = asyncio.run(_run(plant, arguments.duration))
    plant.end(forget=not terminated)
    report = plant.report()
    if arguments.json:
        print_json(report)
    else:
        _LOG.info("stopped after %d steps and %d outages", report["steps"], report["outages"])
    return 0


def _prepare(config: Config, arguments: argparse.Namespace) -> RemotePlant:
    if config.plant is None:
        raise ConfigError([f"{arguments.config}: has no plant; add a section 'plant:'"])
    host, port = arguments.connect
    where = f"{host}:{port}/{arguments.unit}"
    state = StateFile.of(config, where, arguments.state)
    scenario = configured_scenario(config) + scenario_of(arguments)
    coupling = make_coupling(config, scenario)
    refuse_tags(scenario, coupling.plant)
    try:
        link = ModbusPlant(coupling, make_map(config), host, port, arguments.unit)
    except UnmappedError as problem:
        raise config.mistake(("plant",), problem) from None
    return RemotePlant(link, config.plant.period or config.cycle, state, arguments.fresh)


async def _run(plant: RemotePlant, duration_ns: int | None) -> bool:
    """Run, and return whether another process ended it, which may start it again."""
    received: list[signal.Signals] = []

    def stop(number: signal.Signals) -> None:
        received.append(number)
        plant.stop()

    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop, number)
    await plant.run(duration_ns)
    return signal.SIGTERM in received
