"""The configuration: what it takes, and what it says of every kind of mistake."""

from __future__ import annotations

import os
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import pytest

from plcemu.base.errors import ConfigError
from plcemu.runtime.config import Config, find_config, load_config

Load = Callable[..., Config]
PLANT = "program: main.il\nplant:\n  model: batch_plant\n"


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Return a function that loads a text as `c.yaml` of the working folder."""
    monkeypatch.chdir(tmp_path)

    def load_text(text: str | bytes, *overrides: str) -> Config:
        data = text if isinstance(text, bytes) else text.encode()
        Path("c.yaml").write_bytes(data)
        return load_config("c.yaml", overrides)
    return load_text


MISTAKES = {
    "a number is no duration": (
        "program: a\ncycle: 10\n",
        ("c.yaml:2: cycle: found 10, expected a number with a unit of d, h, min, s, ms, us or "
         "ns, such as 10ms")),
    "a cycle takes time": (
        "program: a\ncycle: 0s\n",
        "c.yaml:2: cycle: found '0s', expected a duration of more than 0"),
    "a phase is not negative": (
        "program: a\ntasks:\n  fast: {interval: 5ms, phase: -1ms, programs: a}\n",
        "c.yaml:3: tasks.fast.phase: found '-1ms', expected a duration of 0 or more"),
    "an unknown unit": (
        "program: a\nmodbus:\n  idle_timeout: 10parsecs\n",
        ("c.yaml:3: modbus.idle_timeout: found '10parsecs', expected a number with a unit of "
         "d, h, min, s, ms, us or ns, such as 10ms")),
    "no program": (
        "name: x\n",
        "c.yaml: program is missing"),
    "a missing key deeper down": (
        "program: a\nmodbus:\n  ranges:\n  - {type: coil, first: 0, count: 8}\n",
        "c.yaml:4: modbus.ranges.0.area is missing"),
    "an unknown key": (
        "program: a\ncycel: 10ms\n",
        "c.yaml:2: there is no key 'cycel'; did you mean 'cycle'?"),
    "an unknown key of a task": (
        "program: a\ntasks:\n  fast: {intervall: 5ms, interval: 5ms, programs: a}\n",
        "c.yaml:3: there is no key 'tasks.fast.intervall'; did you mean 'interval'?"),
    "an unknown key of a point": (
        PLANT + "  inputs:\n    B1.level: {address: '%IW0', skale: 1}\n",
        "c.yaml:5: there is no key 'plant.inputs.B1.level.skale'; did you mean 'scale'?"),
    "a key that is no text": (
        "program: a\n7: a\n",
        "c.yaml:2: the key 7 must be a text"),
    "a key that is a list": (
        "program: a\n[x]: a\n",
        "c.yaml:2: found a key that is no plain text"),
    "a key twice": (
        "program: a\ncycle: 1s\ncycle: 2s\n",
        "c.yaml:3: the key 'cycle' is there twice"),
    "a port out of range": (
        "program: a\nmodbus: {port: 70000}\n",
        "c.yaml:2: modbus.port: found 70000, expected less than or equal to 65535"),
    "a unit out of range": (
        "program: a\nmodbus:\n  units: [1, 300]\n",
        "c.yaml:3: modbus.units.1: found 300, expected less than or equal to 255"),
    "a section that is a number": (
        "program: a\nplant: 5\n",
        "c.yaml:2: plant: found 5, expected keys and values"),
    "a section that is empty": (
        "program: a\nmodbus:\n",
        "c.yaml:2: modbus: found None, expected keys and values"),
    "a program that is a mapping": (
        "program: {a: b}\n",
        "c.yaml:1: program: found keys and values, expected a list"),
    "a program that is no name": (
        "program:\n- a\n- 5\n",
        "c.yaml:3: program.1: found 5, expected string"),
    "a factor that is no number": (
        "program: a\nspeed: fast\n",
        "c.yaml:2: speed: found 'fast', expected a number between 1e-9 and 1e9"),
    "a factor that would fill the memory": (
        "program: a\nspeed: 1e999999999\n",
        "c.yaml:2: speed: found '1e999999999', expected a number between 1e-9 and 1e9"),
    "a factor of nothing": (
        PLANT + "  time_scale: 0\n",
        "c.yaml:4: plant.time_scale: found 0, expected a number between 1e-9 and 1e9"),
    "a factor by nothing": (
        "program: a\nspeed: 1/0\n",
        "c.yaml:2: speed: found '1/0', expected a number between 1e-9 and 1e9"),
    "a sensor at an output": (
        PLANT + "  inputs:\n    B1.level: '%QW0'\n",
        ("c.yaml:5: plant.inputs.B1.level.address: found '%QW0', expected an address %I...: "
         "sensors go to inputs (%I), actuators follow outputs (%Q)")),
    "an actuator at an input": (
        PLANT + "  outputs:\n    V1: '%IX0.0'\n",
        ("c.yaml:5: plant.outputs.V1.address: found '%IX0.0', expected an address %Q...: "
         "sensors go to inputs (%I), actuators follow outputs (%Q)")),
    "no address": (
        PLANT + "  inputs:\n    B1.level: here\n",
        ("c.yaml:5: plant.inputs.B1.level.address: found 'here', expected an address: 'here' "
         "is not an address; write %IX0.0, %QW3, %MD1 and the like")),
    "a range of an unknown table": (
        "program: a\nmodbus:\n  ranges:\n  - {type: relay, first: 0, count: 8, area: QX}\n",
        ("c.yaml:4: modbus.ranges.0.type: found 'relay', expected 'discrete', 'coil', 'input' "
         "or 'holding'")),
    "a range that is only written": (
        ("program: a\nmodbus:\n  ranges:\n  - {type: coil, first: 0, count: 8, area: QX, "
         "access: w}\n"),
        "c.yaml:4: modbus.ranges.0.access: found 'w', expected 'r' or 'rw'"),
    "a safe output that is a text": (
        "program: a\nsafe_outputs: {x: open}\n",
        "c.yaml:2: safe_outputs.x: found 'open', expected true, false or a number"),
    "a date": (
        "program: a\nname: 2020-09-09\n",
        "c.yaml:2: name: found datetime.date(2020, 9, 9), expected string"),
    "a date that does not exist": (
        "program: a\nname: 2020-99-99\n",
        "c.yaml: month must be in 1..12"),
    "an object of Python": (
        "program: a\nname: !!python/object:os.system x\n",
        ("c.yaml:2: could not determine a constructor for the tag "
         "'tag:yaml.org,2002:python/object:os.system'")),
    "a list": (
        "- program: a\n",
        "c.yaml:1: found a list, expected keys and values"),
    "a text": (
        "program\n",
        "c.yaml:1: found a text, expected keys and values"),
    "nothing": (
        "",
        "c.yaml: is empty; write at least 'program: FILE'"),
    "nothing but comments": (
        "# later\n",
        "c.yaml: is empty; write at least 'program: FILE'"),
    "an open bracket": (
        "program: [\n",
        "c.yaml:2: expected the node content, but found '<stream end>'"),
    "a tabulator": (
        "program: a\n\tcycle: 1s\n",
        "c.yaml:2: found character '\\t' that cannot start any token"),
    "a control character": (
        "program: \x01\n",
        "c.yaml: unacceptable character #x0001: special characters are not allowed"),
    "Latin-1": (
        b"name: K\xf6ln\n",
        "c.yaml: is not UTF-8 text"),
    "UTF-16": (
        "program: a\n".encode("utf-16"),
        "c.yaml: is not UTF-8 text"),
    "too large a file": (
        b"#" * 1_000_001,
        "c.yaml: larger than 1000000 bytes, the limit"),
    "deep nesting": (
        "a: " + "[" * 5000,
        "c.yaml: values stand in each other deeper than 30, the limit"),
    "an alias to itself": (
        "program: a\nb: &b [*b]\n",
        "c.yaml:2: values stand in each other deeper than 30, the limit"),
    "itself as the base": (
        "extends: c.yaml\n",
        "c.yaml:1: extends: c.yaml extends this file, in a circle"),
    "a base that is not there": (
        "name: x\nextends: nowhere.yaml\n",
        ("c.yaml:2: extends: nowhere.yaml: there is no such file; name a configuration file, "
         "or a folder that holds config.yaml")),
    "a base that is a number": (
        "extends: 5\n",
        "c.yaml:1: extends: found 5, expected a file or folder"),
}


@pytest.mark.parametrize(("text", "said"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_told_with_its_place(load: Load, text: str | bytes, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(text)
    assert caught.value.problems == [said]


def test_all_mistakes_are_told_at_once(load: Load) -> None:
    with pytest.raises(ConfigError) as caught:
        load("cycle: 10\nspeed: x\nmodbus:\n  port: -1\n")
    assert [p.split(": ")[0] for p in caught.value.problems] == ["c.yaml", "c.yaml:1", "c.yaml:2",
                                                                 "c.yaml:4"]


def test_a_bomb_of_aliases_is_refused_quickly(load: Load) -> None:
    bomb = "".join(f"k{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12))
    with pytest.raises(ConfigError, match=r"more than 100000 values, the limit"):
        load("k0: &a0 [1]\n" + bomb)


def test_a_huge_wrong_value_is_not_told_in_full(load: Load) -> None:
    with pytest.raises(ConfigError) as caught:
        load(f"program: a\ncycle: {'9' * 5000}x\n")
    assert len(caught.value.problems[0]) < 300


def test_what_is_not_said_has_a_default(load: Load) -> None:
    config = load("program: a.il\n")
    assert (config.cycle, config.modbus.host, config.modbus.port) == (10_000_000, "127.0.0.1", 5020)


def test_a_byte_order_mark_is_no_mistake(load: Load) -> None:
    assert load("\ufeffprogram: a\n").program == ["a"]


def test_a_name_of_digits_needs_no_quotes(load: Load) -> None:
    assert load("program: a\nname: 7\n").name == "7"


def test_an_address_alone_is_a_point_without_scale(load: Load) -> None:
    config = load(PLANT + "  inputs:\n    B1.level: '%IW3'\n")
    assert config.plant is not None
    point = config.plant.inputs["B1.level"]
    assert (point.address, point.scale) == ("%IW3", Fraction(1))


def test_a_scale_is_exact(load: Load) -> None:
    config = load(PLANT + "  inputs:\n    B1.level: {address: '%IW3', scale: 0.1}\n")
    assert config.plant is not None
    assert config.plant.inputs["B1.level"].scale == Fraction(1, 10)


# extends


def test_paths_are_relative_to_the_file_that_holds_them(tmp_path: Path) -> None:
    (tmp_path / "base").mkdir()
    (tmp_path / "base" / "config.yaml").write_text("program: a.il\nproperties: [p.prop]\n")
    (tmp_path / "config.yaml").write_text("extends: base\nproperties: q.prop\n")
    config = load_config(tmp_path)
    assert config.program == [str(tmp_path / "base" / "a.il")]
    assert config.properties == [str(tmp_path / "q.prop")]


def test_an_extending_file_overrides_key_by_key(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(PLANT + "  parameters: {load: 2, brim_l: 1}\n")
    (tmp_path / "c.yaml").write_text("extends: base.yaml\nplant:\n  parameters:\n    load: 5\n")
    config = load_config(tmp_path / "c.yaml")
    assert config.plant is not None
    assert config.plant.parameters == {"load": 5, "brim_l": 1}


def test_a_mistake_in_the_base_is_told_with_the_base_s_place(load: Load, tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text("program: a\ncycle: 10\n")
    with pytest.raises(ConfigError, match=r"^base.yaml:2: cycle: found 10"):
        load("extends: base.yaml\n")


def test_files_that_extend_each_other_are_told(load: Load, tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text("extends: c.yaml\n")
    with pytest.raises(ConfigError, match=r"base.yaml:1: extends: .*c.yaml extends this file"):
        load("extends: base.yaml\n")


def test_a_long_chain_of_bases_is_refused(load: Load, tmp_path: Path) -> None:
    for n in range(12):
        (tmp_path / f"b{n}.yaml").write_text(f"extends: b{n + 1}.yaml\n")
    with pytest.raises(ConfigError, match="extends goes deeper than 8 files"):
        load("extends: b0.yaml\n")


# --set


def test_a_short_name_is_a_parameter_of_the_plant_first(load: Load) -> None:
    config = load(PLANT, "load=3", "time_scale=100", "port=1502", "cycle=5ms")
    assert config.plant is not None
    assert config.plant.parameters == {"load": 3}
    assert config.plant.time_scale == 100
    assert (config.modbus.port, config.cycle) == (1502, 5_000_000)


def test_a_path_overrides_any_key(load: Load) -> None:
    config = load(PLANT, "plant.parameters.load=3", "modbus.enabled=false",
                  "safe_outputs.MAIN.pump=true", "plant.inputs.B1.level=%IW7",
                  "plant.inputs.B1.level.scale=0.5")
    assert config.plant is not None
    point = config.plant.inputs["B1.level"]
    assert (point.address, point.scale) == ("%IW7", Fraction(1, 2))
    assert (config.plant.parameters, config.modbus.enabled) == ({"load": 3}, False)
    assert config.safe_outputs == {"MAIN.pump": True}


def test_the_last_override_counts(load: Load) -> None:
    assert load(PLANT, "cycle=5ms", "cycle=7ms").cycle == 7_000_000


WRONG_OVERRIDES = {
    "cycle": "--set cycle: expected NAME=VALUE",
    "=3": "--set =3: expected NAME=VALUE",
    "cycle=10": "--set cycle=10: cycle: found 10, expected a number with a unit",
    "cycle.x=3": "c.yaml:2: cycle: found|--set cycle.x=3: cycle holds a value, not keys",
    "laod=3": "--set laod: there is no such parameter; did you mean 'load'\\?; the plant's "
              "parameters are load, half",
    "prot=3": "--set prot: there is no such parameter; did you mean 'port'\\?",
    "plnt.x=3": "--set plnt.x: there is no key 'plnt'; did you mean 'plant'\\?",
    "modbus.prot=3": "--set modbus.prot=3: there is no key 'modbus.prot'; did you mean 'port'\\?",
    "program=[a, 5]": "--set program=\\[a, 5\\]: program.1: found 5, expected string",
}


@pytest.mark.parametrize(("override", "said"), WRONG_OVERRIDES.items())
def test_a_wrong_override_is_told(load: Load, override: str, said: str) -> None:
    with pytest.raises(ConfigError, match=f"^(?:{said})"):
        load("program: a\ncycle: 5ms\nplant:\n  model: batch_plant\n", override)


@pytest.mark.parametrize("text", ["[1", "2020-99-99", "!!python/object:x y", "[" * 3000])
def test_an_override_that_is_no_yaml_is_a_text(load: Load, text: str) -> None:
    assert load("program: a\n", f"name={text}").name == text


def test_overrides_survive_a_plant_that_is_nonsense(load: Load) -> None:
    with pytest.raises(ConfigError, match="there is no such parameter"):
        load("program: a\nplant:\n  model: [x]\n", "load=3")


# finding the file


def test_a_folder_stands_for_its_config_yaml(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("program: a\n")
    assert find_config(tmp_path) == tmp_path / "config.yaml"


def test_without_a_name_the_working_folder_is_meant(tmp_path: Path,
                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("config.yaml").write_text("program: a\n")
    assert find_config(None) == Path("config.yaml")


@pytest.mark.parametrize("name", ["nowhere", "a" * 5000, "a/b/c", os.devnull])
def test_a_file_that_is_not_there_is_told(name: str) -> None:
    with pytest.raises(ConfigError, match=r"there is no such file|cannot be read"):
        find_config(name)
