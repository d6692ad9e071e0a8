"""`plcemu debug`: commands in, places and values out."""

import io
import json

from systems import write_config

from plcemu.cli.main import main


def test_debug_executes_commands_and_says_where_it_stands(tmp_path, capsys):
    config = write_config(tmp_path, "program: main.il\n")
    code = main(["debug", str(config), "--execute",
                 "set start = TRUE; watch count; run; print count; trace count; back; info"])
    out = capsys.readouterr().out
    assert code == 0
    assert "watch: MAIN.count: 0 -> 1" in out
    assert "main.il:11 `ST  count`" in out
    assert "history: from scan 0 to 1" in out


def test_debug_reads_commands_from_a_pipe_and_tells_of_wrong_ones(tmp_path, capsys, monkeypatch):
    config = write_config(tmp_path, "program: main.il\n")
    monkeypatch.setattr("sys.stdin", io.StringIO(
        "# a comment\nscan 3\nbreak 999\nfly\nscan x\nset start\nprint cuont\nquit\nscan\n"))
    code = main(["debug", str(config)])
    out, err = capsys.readouterr()
    assert code == 2
    assert "before scan 3, t = 30ms, RUN" in out
    assert [line for line in err.splitlines() if line] == [
        f"'999': there is no code at this line; the nearest is {tmp_path / 'main.il'}:16",
        "there is no command 'fly'; `help` lists them",
        "found 'x', expected a number of 1 or more", "write TAG = VALUE",
        "there is no tag 'cuont'; did you mean 'count'?"]


def test_debug_gives_one_json_document(tmp_path, capsys):
    config = write_config(tmp_path, "program: main.il\n")
    assert main(["debug", str(config), "--json", "--execute", "until 50ms; print count"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["commands"][1] == {"command": "print count", "output": ["count = 0"]}
