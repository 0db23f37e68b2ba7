"""Wrong inputs of every command: an exit code and one sentence, soon and in little memory."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path

import pytest
from wrong_inputs import ROWS, Forker, Row, cost_of, lay_out

from controller.cli import app as app_module
from controller.cli import main
from controller.cli.terminal import progress

ROOT = Path(__file__).parents[2]
MAX_BYTES = 220 * 2**20  # imports alone take 196
# one of each kind in a process of its own, forked after the imports, which take most of its time;
# benchmarks/bench_inputs.py asks all of them in processes that begin with nothing
OWN_PROCESS = (
    "recipe is /dev/zero", "recipe of 10 GB", "deep YAML", "billion laughs", "impossible date",
    "unit of a part in mm is inch", "camera pose in metres", "part up and outside",
    "part of 4 billion triangles", "CSG bomb", "PNG of 60000 x 60000", "picture is /dev/zero",
    "picture of 10 GB",
    "deep JSON", "runs that cannot be made", "speed nan",
)  # fmt: skip
BY_NAME = {row.name: row for row in ROWS}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "here"
    place.mkdir()
    lay_out(place)
    monkeypatch.chdir(place)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(progress, "QUIET_S", 3600.0)  # a busy machine takes longer, and reports it
    return place


@pytest.fixture(scope="module")
def forker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Forker]:
    row, folder = BY_NAME["recipe of 10 GB"], tmp_path_factory.mktemp("refused_unread")
    lay_out(folder)
    row.prepare(folder)
    alone = cost_of(row, folder)
    require_one_sentence(row, alone.code, alone.said)
    forker = Forker(tmp_path_factory.mktemp("forker"), alone.peak_bytes)
    yield forker
    forker.close()


def require_one_sentence(row: Row, code: int, said: str) -> None:
    assert code == row.code, said
    assert "Traceback" not in said
    assert "this is a bug" not in said
    assert row.says in said, said
    lines = said.strip().splitlines()
    if lines[0].startswith("Usage:"):
        lines = lines[-1:]
    # several things wrong in one file are a line each
    file = lines[0].removeprefix("cellctl: ").split(":")[0]
    assert row.code == 1 or all(line.startswith(file) for line in lines[1:]), said


def test_there_are_more_than_sixty_of_them_and_no_two_alike() -> None:
    assert len(ROWS) >= 60
    assert len(BY_NAME) == len(ROWS)
    assert len({(row.prepare, row.command) for row in ROWS}) == len(ROWS)
    commands = {row.command[0] for row in ROWS}
    every = {"run", "check", "compile", "recognise", "calibrate", "plan", "emulate", "report"}
    assert every | {"doctor"} <= commands


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_a_wrong_input_is_answered_with_one_sentence(
    row: Row, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row.prepare(folder)
    before = sorted(folder.rglob("*"))
    code = main(list(row.command))
    require_one_sentence(row, code, capsys.readouterr().err)
    assert sorted(folder.rglob("*")) == before  # nothing was begun


@pytest.mark.parametrize("name", OWN_PROCESS)
def test_it_takes_little_memory(name: str, folder: Path, forker: Forker) -> None:
    row = BY_NAME[name]
    row.prepare(folder)
    cost = forker.cost_of(row, folder, folder.parent / "cache")
    require_one_sentence(row, cost.code, cost.said)
    assert cost.peak_bytes < MAX_BYTES


def test_too_little_room_for_a_run_is_said_before_it_begins(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**9, 9 * 10**8, 10**8))
    assert main(["run", "recipe.yaml", "--runs", "runs"]) == 2
    said = capsys.readouterr().err
    assert "--runs runs: 100 MB are free there, 200 MB are required" in said
    assert not (folder / "runs").exists()


@pytest.mark.parametrize("number", [errno.EROFS, errno.ENOSPC, errno.EACCES, errno.EDQUOT])
def test_a_folder_that_takes_no_files_is_said_before_it_begins(
    number: int, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    assert main(["run", "recipe.yaml", "--runs", "runs"]) == 2
    assert os.strerror(number) in capsys.readouterr().err


def test_a_file_name_that_is_no_text_is_printed_all_the_same(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = os.fsdecode(b"gr\xf6\xdfe\x1b[31m.yaml")
    assert main(["check", name]) == 2
    said = capsys.readouterr().err
    assert "\\x1b[31m" in said
    assert "\x1b" not in said
    assert "No such file" in said


def test_an_error_nobody_expected_is_a_sentence_and_a_file(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def break_down(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr("controller.cli.planning.recipe_check.check_every_pose", break_down)
    assert main(["check", "recipe.yaml"]) == 1
    said = capsys.readouterr().err
    assert "ZeroDivisionError: of all things; this is a bug of cellctl; details in" in said
    assert len(said.strip().splitlines()) == 1
    (file,) = (tmp_path / "cache" / "cellctl").glob("bug-*.txt")
    assert str(file) in said
    details = file.read_text()
    assert "Traceback" in details
    assert "break_down" in details
    assert "command line: check recipe.yaml" in details
    assert main(["--verbose", "check", "recipe.yaml"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_an_error_nobody_expected_on_a_full_disk_is_still_a_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def break_down(*_: object, **__: object) -> None:
        raise RecursionError

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("controller.cli.planning.recipe_check.check_every_pose", break_down)
    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["check", "recipe.yaml"]) == 1
    assert "RecursionError; this is a bug of cellctl; no file could" in capsys.readouterr().err


def test_an_error_of_the_system_is_no_bug(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "some/file")

    monkeypatch.setattr("controller.cli.planning.recipe_check.check_every_pose", full)
    assert main(["check", "recipe.yaml"]) == 1
    assert capsys.readouterr().err == "cellctl: some/file: No space left on device\n"


def test_ctrl_c_is_no_traceback(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("controller.cli.parts.compiling.cached_part", interrupt)
    assert main(["compile", "block.stl"]) in (1, 130)
    assert "Traceback" not in capsys.readouterr().err


def test_a_reader_that_has_read_enough_is_no_error(folder: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "controller.cli", "compile", "block.stl", "--unit", "mm"],
            cwd=folder,
            stdout=writing,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            check=False,
        )
    finally:
        os.close(writing)
    assert done.returncode == 0  # what it was asked for is done
    # on a slow machine it reports that it is at work; nothing else
    assert all(line.endswith(" s so far)") for line in done.stderr.splitlines()), done.stderr


def test_every_command_is_asked_through_the_same_door() -> None:
    # a command that is added gets its rows here as well
    names = {command.name for command in app_module.app.registered_commands}
    names |= {group.name for group in app_module.app.registered_groups}
    known = {row.command[0] for row in ROWS}
    assert names <= known
