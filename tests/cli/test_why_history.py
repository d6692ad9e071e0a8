"""`plcemu why`, `history` and `monitor` on files of the historian and of other tools."""

import json

from systems import write_config

from plcemu.base.tags import Tag, TagTable
from plcemu.base.trace import Frame
from plcemu.base.tracefile import load
from plcemu.cli.main import main
from plcemu.runtime.historian import Historian

S = 1_000_000_000


def config(folder):
    (folder / "on.yaml").write_text("- {at: 100ms, set: {start: true}}\n")
    return write_config(folder, "program: main.il\n")


def recorded(folder):
    tags = TagTable([Tag("MAIN.pump", "BOOL"), Tag("level", "INT")])
    historian = Historian(folder / "h.sqlite", "tank", lambda: tags)
    for n in range(5):
        historian.observe(Frame(n * S, n, ((0, n % 2 == 1), (1, n))))
    historian.close()
    return str(folder / "h.sqlite")


def test_why_prints_a_tree_with_files_and_lines(tmp_path, capsys):
    path = config(tmp_path)
    assert main(["why", "pump", str(path), "--at", "3s", "--scenario",
                 str(tmp_path / "on.yaml")]) == 0
    out = capsys.readouterr().out
    assert out.startswith("at 3s:\nMAIN.pump = TRUE  since 2.1s")
    assert "timer: ET 2s of PT 2s" in out
    assert "written by scenario at %IX0.0" in out


def test_why_gives_one_json_document_and_tells_of_wrong_names(tmp_path, capsys):
    path = config(tmp_path)
    assert main(["why", str(path), "%QX0.0", "--at", "50ms", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["tag"], document["value"], document["causes"][0]["tag"]) == \
        ("MAIN.pump", False, "MAIN.delay.Q")
    assert main(["why", "pomp", str(path), "--at", "1s"]) == 2
    assert "did you mean" in capsys.readouterr().err


def test_history_lists_runs_prints_changes_and_exports(tmp_path, capsys):
    path = recorded(tmp_path)
    assert main(["history", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["runs"][0]["frames"] == 5
    assert main(["history", path, "--tags", "level", "--from", "3s"]) == 0
    assert [line.split() for line in capsys.readouterr().out.splitlines()] == [
        ["3s", "level", ":=", "3"], ["4s", "level", ":=", "4"]]
    assert main(["history", path, "--export", str(tmp_path / "x.vcd")]) == 0
    assert load(tmp_path / "x.vcd").history("level")[-1] == (4 * S, 4)


def test_monitor_judges_a_historians_file_and_a_table_of_another_tool(tmp_path, capsys):
    (tmp_path / "p.prop").write_text("off: G !pump\n")
    assert main(["monitor", recorded(tmp_path), str(tmp_path / "p.prop"), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["properties"][0]["decided_at_s"] == 1.0
    (tmp_path / "scope.csv").write_text("Time;CH1\n0;0\n250;1\n")
    assert main(["monitor", str(tmp_path / "scope.csv"), str(tmp_path / "p.prop"), "--unit", "ms",
                 "--time", "Time", "--rename", "CH1=pump", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["properties"][0]["decided_at_s"] == 0.25
