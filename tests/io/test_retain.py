"""The file of retained variables: whole commits or none, whatever happens to its bytes."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plcemu.io import retain
from plcemu.io.committer import Committer, Progress
from plcemu.io.retain import Commit, RetainedImage, RetainError, RetainFile, pack, unpack
from plcemu.ir.shape import Array, Record, Scalar, Variable, from_plain, match, to_plain

INT, BOOL = Scalar("INT", 2), Scalar("BOOL", 1)
PAIR = Record("", (("a", 0, INT), ("b", 2, INT)), 4)
VARIABLES = (Variable("MAIN.n", "INT", INT, 0), Variable("MAIN.pair", "PAIR", PAIR, 8),
             Variable("MAIN.row", "ROW", Array(INT, ((1, 3),), 2), 16))
IMAGE = RetainedImage(VARIABLES)


def state(n: int) -> bytes:
    return IMAGE.gather(bytes([n]) * 64)


def file_with(path: Path, *numbers: int) -> RetainFile:
    file = RetainFile(path)
    file.read()
    for n in numbers:
        file.commit(IMAGE.schema, state(n))
    file.close()
    return file


def data_in(path: Path) -> bytes:
    commit = RetainFile(path).read().commit
    assert commit is not None
    return commit.data


# ---------------------------------------------------------------- commits


def test_without_a_file_nothing_is_found_and_nothing_is_wrong(tmp_path: Path) -> None:
    found = RetainFile(tmp_path / "none").read()
    assert (found.commit, found.problems, found.is_first) == (None, [], True)


def test_the_last_commit_is_found_and_the_count_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "kept"
    for n in range(1, 8):
        file_with(path, n)
        found = RetainFile(path).read()
        assert found.commit is not None
        assert (found.commit.sequence, found.commit.data, found.problems) == (n, state(n), [])


def test_a_commit_leaves_the_one_before_whole_in_the_other_slot(tmp_path: Path) -> None:
    file_with(tmp_path / "kept", 1, 2, 3)
    raw = (tmp_path / "kept").read_bytes()
    slots = [unpack(raw, at) for at in range(0, len(raw), retain.BLOCK)]
    assert sorted(slot.data for slot in slots if slot) == [state(2), state(3)]


def test_other_variables_make_a_new_file_and_keep_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    file = file_with(path, 1)
    file.read()
    other = RetainedImage(VARIABLES[:1])
    made = file.commit(other.schema, other.gather(bytes([9]) * 64))
    file.close()
    assert (made.sequence, data_in(path), data_in(file.previous)) == (2, b"\x09\x09", state(1))


def test_a_file_that_somebody_deleted_is_made_again(tmp_path: Path) -> None:
    file = RetainFile(tmp_path / "kept")
    file.commit(IMAGE.schema, state(1))
    file.commit(IMAGE.schema, state(2))
    (tmp_path / "kept").unlink()
    file.commit(IMAGE.schema, state(3))
    file.close()
    assert data_in(tmp_path / "kept") == state(3)


def test_a_second_process_cannot_write_the_file(tmp_path: Path) -> None:
    one, two = RetainFile(tmp_path / "kept"), RetainFile(tmp_path / "kept")
    one.commit(IMAGE.schema, state(1))
    with pytest.raises(RetainError, match="in use by another process"):
        two.commit(IMAGE.schema, state(2))
    one.close()
    two.close()


# ---------------------------------------------------------------- damage


def both_commits(tmp_path: Path) -> tuple[Path, bytes]:
    path = tmp_path / "kept"
    file_with(path, 1, 2)
    return path, path.read_bytes()


def judge(path: Path) -> None:
    """What is found is one of the two commits; anything but the last is told and kept aside."""
    raw = path.read_bytes()
    found = RetainFile(path).read()
    data = found.commit.data if found.commit else None
    assert data in (state(2), state(1), None)
    assert found.problems or data == state(2)
    for problem in found.problems:
        aside = Path(problem.rsplit("the file is kept as ", 1)[1])
        assert aside.read_bytes() == raw
        aside.unlink()


def test_a_file_cut_off_anywhere_gives_a_whole_commit_or_says_there_is_none(
        tmp_path: Path) -> None:
    path, raw = both_commits(tmp_path)
    written = [n for n, byte in enumerate(raw) if byte]
    for size in {0, *written, *(n + 1 for n in written), retain.BLOCK}:
        path.write_bytes(raw[:size])
        judge(path)


def test_any_wrong_byte_leaves_at_least_one_whole_commit(tmp_path: Path) -> None:
    path, raw = both_commits(tmp_path)
    used = len(pack(Commit(1, 0, IMAGE.schema, state(1))))
    for at in [*range(used), *range(retain.BLOCK, retain.BLOCK + used)]:
        path.write_bytes(raw[:at] + bytes([raw[at] ^ 0x55]) + raw[at + 1:])
        found = RetainFile(path).read()
        assert found.commit is not None and found.commit.data in (state(1), state(2))
        judge(path)


@given(st.binary(max_size=9000), st.integers(0, 8191))
def test_no_bytes_are_misread(tmp_path_factory: pytest.TempPathFactory, noise: bytes,
                              at: int) -> None:
    path, raw = both_commits(tmp_path_factory.mktemp("noise"))
    path.write_bytes(raw[:at] + noise + raw[at + len(noise):])
    judge(path)


def test_damaged_files_kept_aside_do_not_pile_up(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    for n in range(2 * retain.KEPT_ASIDE):
        path.write_bytes(b"junk %d" % n)
        RetainFile(path).read()
    kept = sorted(tmp_path.glob("kept.damaged-*"))
    assert [p.read_bytes() for p in kept] == [b"junk %d" % n for n in range(5, 10)]


def test_a_commit_over_a_damaged_file_makes_a_whole_one(tmp_path: Path) -> None:
    path, raw = both_commits(tmp_path)
    path.write_bytes(raw[:retain.BLOCK])
    file_with(path, 7)
    assert (data_in(path), RetainFile(path).read().problems) == (state(7), [])


def test_a_folder_in_place_of_the_file_is_told_and_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    path.mkdir()
    file = RetainFile(path)
    assert "cannot be read" in file.read().problems[0]
    with pytest.raises(RetainError, match="not overwritten"):
        file.commit(IMAGE.schema, state(1))
    file.close()


# ---------------------------------------------------------------- disks that refuse


def refusing(monkeypatch: pytest.MonkeyPatch, name: str, number: int) -> None:
    def refuse(*_: object) -> int:
        raise OSError(number, os.strerror(number))
    monkeypatch.setattr(retain.os, name, refuse)


@pytest.mark.parametrize(("call", "number", "text"), [
    ("pwrite", errno.ENOSPC, "No space left"), ("open", errno.EROFS, "Read-only"),
    ("fdatasync", errno.EIO, "Input/output"), ("open", errno.EACCES, "Permission denied")])
def test_a_commit_that_fails_says_why_and_spoils_nothing(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, number: int,
        text: str) -> None:
    path = tmp_path / "kept"
    file = file_with(path, 1, 2)
    file.read()
    with monkeypatch.context() as broken:
        refusing(broken, call, number)
        with pytest.raises(RetainError, match=text):
            file.commit(IMAGE.schema, state(3))
    assert data_in(path) in (state(2), state(3))
    file.commit(IMAGE.schema, state(4))
    file.close()
    assert data_in(path) == state(4)


def test_a_disk_full_at_the_first_commit_leaves_no_half_file(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = RetainFile(tmp_path / "kept")
    with monkeypatch.context() as full:
        refusing(full, "pwrite", errno.ENOSPC)
        with pytest.raises(RetainError, match="No space left"):
            file.commit(IMAGE.schema, state(1))
    assert [p.name for p in tmp_path.iterdir()] == ["kept.lock"]


# ---------------------------------------------------------------- the thread


class SlowFile(RetainFile):
    """Waits in its first commit until it is told to go on."""

    def __init__(self, path: Path) -> None:
        import threading
        super().__init__(path)
        self.begun, self.go_on = threading.Event(), threading.Event()
        self.committed: list[bytes] = []

    def commit(self, schema: bytes, data: bytes) -> Commit:
        self.begun.set()
        assert self.go_on.wait(10)
        self.committed.append(data)
        return super().commit(schema, data)


def test_of_states_that_wait_only_the_latest_is_committed(tmp_path: Path) -> None:
    file = SlowFile(tmp_path / "kept")
    committer = Committer(file, Progress())
    committer.submit(IMAGE.schema, state(1), scan=1)
    assert file.begun.wait(10)
    for n in range(2, 9):
        committer.submit(IMAGE.schema, state(n), scan=n)
    assert committer.pending and committer.progress.sequence == 0
    file.go_on.set()
    assert committer.close(10)
    assert file.committed == [state(1), state(8)]
    assert (committer.progress.sequence, committer.progress.scan) == (2, 8)


def test_a_commit_that_fails_is_told_and_the_next_one_mends_it(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    committer = Committer(RetainFile(tmp_path / "kept"), Progress())
    with monkeypatch.context() as full:
        refusing(full, "pwrite", errno.ENOSPC)
        committer.submit(IMAGE.schema, state(1), scan=1)
        assert committer.flush(10)
    assert "No space left" in committer.progress.error and committer.progress.sequence == 0
    committer.submit(IMAGE.schema, state(2), scan=2)
    assert committer.close(10)
    assert (committer.progress.error, data_in(tmp_path / "kept")) == ("", state(2))


def test_a_committer_that_never_got_anything_touches_no_file(tmp_path: Path) -> None:
    assert Committer(RetainFile(tmp_path / "kept"), Progress()).close(1)
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------- names and types


def carried(old: tuple[Variable, ...], new: tuple[Variable, ...], block: bytes) -> bytearray:
    result = bytearray(64)
    match(old, new).carry(block, result)
    return result


def test_values_move_with_their_names_wherever_they_stand() -> None:
    moved = tuple(Variable(v.name.upper(), v.type, v.shape, v.offset + 20) for v in VARIABLES)
    block = bytes(range(64))
    assert carried(VARIABLES, moved, block)[20:42] == \
        b"\0\1" + bytes(6) + bytes(range(8, 12)) + bytes(4) + bytes(range(16, 22))


@pytest.mark.parametrize("other", [
    Scalar("UINT", 2), Scalar("INT(0..5)", 2), Scalar("(RED=0,GREEN=1)", 4), PAIR,
    Array(INT, ((0, 0),), 2)])
def test_a_variable_of_another_type_is_dropped(other: Scalar | Record | Array) -> None:
    found = match(VARIABLES[:1], (Variable("MAIN.n", "X", other, 0),))
    assert (found.moves, found.kept) == ([], [])
    assert (found.added, found.dropped) == (["MAIN.n"], ["MAIN.n"])


def test_of_an_edited_structure_the_fields_that_are_the_same_are_kept() -> None:
    edited = Record("", (("b", 0, INT), ("c", 2, INT)), 4)
    found = match(VARIABLES[1:2], (Variable("MAIN.pair", "PAIR", edited, 30),))
    assert (found.moves, found.kept) == ([(10, 30, 2)], ["MAIN.pair.b"])
    assert (found.added, found.dropped) == (["MAIN.pair.c"], ["MAIN.pair.a"])


def test_of_an_array_with_other_bounds_the_elements_keep_their_subscripts() -> None:
    edited = Variable("MAIN.row", "ROW", Array(INT, ((2, 5),), 2), 40)
    found = match(VARIABLES[2:], (edited,))
    assert found.moves == [(18, 40, 4)] and found.kept == ["MAIN.row[2..3]"]


SCALARS = st.sampled_from([INT, BOOL, Scalar("LREAL", 8), Scalar("STRING[3]", 5)])
SHAPES = st.recursive(SCALARS, lambda inner: st.one_of(
    st.builds(lambda e, low, n: Array(e, ((low, low + n),), e.size), inner,
              st.integers(-2, 2), st.integers(0, 3)),
    st.builds(lambda fields: _record(fields), st.dictionaries(
        st.sampled_from("abcd"), inner, min_size=1, max_size=3))), max_leaves=6)


def _record(fields: dict[str, Scalar | Array | Record]) -> Record:
    at, made = 0, []
    for name, shape in fields.items():
        made.append((name, at, shape))
        at += shape.size
    return Record("", tuple(made), at)


def leaves(name: str, shape: Scalar | Array | Record, at: int) -> dict[tuple[str, str], slice]:
    """Every single value of a variable by name and type: an oracle independent of `match`."""
    if isinstance(shape, Scalar):
        return {(name, shape.type): slice(at, at + shape.size)}
    parts = [(f"{name}[{n}]", shape.element, at + i * shape.stride)
             for i, n in enumerate(range(shape.ranges[0][0], shape.ranges[0][1] + 1))] \
        if isinstance(shape, Array) else [(f"{name}.{f}", s, at + o) for f, o, s in shape.fields]
    return {key: place for part in parts for key, place in leaves(*part).items()}


@given(SHAPES, SHAPES, st.integers(0, 9), st.randoms(use_true_random=False))
def test_exactly_the_values_of_the_same_name_and_type_are_carried(old, new, at, random) -> None:
    before, after = (Variable("v", "V", old, 0),), (Variable("V", "V", new, at),)
    source, target = random.randbytes(old.size), bytearray(b"\xee" * (new.size + at))
    match(before, after).carry(source, target)
    known = leaves("v", old, 0)
    for key, place in leaves("v", new, at).items():
        size = place.stop - place.start
        assert target[place] == (source[known[key]] if key in known else b"\xee" * size)


@given(SHAPES)
def test_a_shape_made_plain_reads_back(shape) -> None:
    assert from_plain(to_plain(shape)) == shape


def test_a_schema_that_cannot_be_read_is_no_commit(tmp_path: Path) -> None:
    file = RetainFile(tmp_path / "kept")
    file.commit(b'[["n","INT",null,0]]', b"\1\0")
    file.close()
    found = RetainFile(tmp_path / "kept").read()
    assert found.commit is None and "holds no whole commit" in found.problems[0]
