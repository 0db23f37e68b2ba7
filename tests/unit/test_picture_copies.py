"""Pictures in a store of objects: copied, proven, read again, and deleted here only then."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from results_bench import RunWriter, good_run, verdict, view

from controller.cell.journal import JOURNAL_NAME, append_beside, rows
from controller.cli import main
from controller.config.cell.connect import ConnectSection
from controller.history import fill, open_store
from controller.history.keeping import Copied, Dropped, copy_pictures, keep_pictures
from controller.results.report import render, report_json
from controller.results.run import (
    ObjectsError,
    ObjectStore,
    RunPictures,
    load_run,
    prove_run,
)

RUN = "20260301-120000-000-featuretype"
NEWER = "20260302-120000-000-featuretype"
LONG_AGO = "2100-01-01"  # of `--drop-pictures-before`: all runs ended before it


def cell_run(runs: Path, run: str, connect: ConnectSection | None) -> None:
    """Write a run whose pictures the journal knows by their hashes."""
    writer = RunWriter(runs, run, connect=connect)
    writer.look()
    writer.plan()
    writer.grasp()
    seen = view("G1-V0")
    writer.show("show with grasp G1", seen, 4.0)
    writer.judge_view(seen)
    writer.judge(verdict())
    writer.place("accept")
    there = sorted((writer.folder / "pictures").iterdir())
    # each of its own, as a camera's are
    for i, path in enumerate(there):
        path.write_bytes(path.read_bytes() + bytes([i]))
    found = {f"pictures/{one.name}": hashlib.sha256(one.read_bytes()).hexdigest() for one in there}
    writer.write(rows.FilesStored(found))
    writer.end()


@pytest.fixture
def objects(tmp_path: Path) -> Path:
    return tmp_path / "objects"


@pytest.fixture
def runs(tmp_path: Path, objects: Path) -> Path:
    """Two runs of a cell that copies its pictures to a folder, of five pictures each."""
    folder = tmp_path / "runs"
    folder.mkdir()
    asked = ConnectSection.model_validate({"pictures": {"copy_to": f"file://{objects}"}})
    for run in (RUN, NEWER):
        cell_run(folder, run, asked)
    return folder


def files_in(folder: Path) -> dict[str, bytes]:
    return {
        one.relative_to(folder).as_posix(): one.read_bytes()
        for one in sorted(folder.rglob("*"))
        if one.is_file()
    }


def pictures_of(runs: Path, run: str = RUN) -> list[Path]:
    return sorted((runs / run / "pictures").iterdir())


def copy_all(runs: Path, objects: Path) -> list[Copied]:
    return list(copy_pictures(runs, f"file://{objects}", "Ann"))


def drop(runs: Path) -> int:
    words = ["history", "--runs", str(runs), "--drop-pictures-before", LONG_AGO, "--yes"]
    return main(words)


def test_copies_are_named_by_their_content_and_noted(runs: Path, objects: Path) -> None:
    done = copy_all(runs, objects)
    assert [(one.run, len(one.files), one.problems) for one in done] == [
        (RUN, 5, ()),
        (NEWER, 5, ()),
    ]
    for name, data in files_in(objects).items():
        digest = hashlib.sha256(data).hexdigest()
        assert name == f"sha256/{digest[:2]}/{digest}.png"
    assert sorted(files_in(objects).values()) == sorted(
        {one.read_bytes() for run in (RUN, NEWER) for one in pictures_of(runs, run)}
    )
    record = load_run(runs, RUN)
    assert {file: copy.sha256 for file, copy in record.copies.items()} == record.stored
    assert {copy.to for copy in record.copies.values()} == {f"file://{objects}"}
    assert copy_all(runs, objects) == []  # nothing is left to copy
    assert prove_run(runs, RUN).tampered == ()


def test_what_was_deleted_here_is_read_from_its_copy(
    runs: Path, objects: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = report_json(load_run(runs, RUN))
    page = render(load_run(runs, RUN))
    kept = files_in(runs / RUN / "pictures")
    copy_all(runs, objects)
    assert drop(runs) == 0
    assert pictures_of(runs) == []
    assert len(pictures_of(runs, NEWER)) == 5  # the newest run keeps its own
    record = load_run(runs, RUN)
    after = report_json(record)
    pictures = after["parts"][0]["table_pictures"]
    assert {one.pop("copied_to") for one in pictures.values()} == {f"file://{objects}"}
    assert pictures == before["parts"][0]["table_pictures"]  # their hashes among it
    assert render(record).count("data:image/jpeg") == page.count("data:image/jpeg") > 0
    assert prove_run(runs, RUN).tampered == ()
    assert main(["history", "--runs", str(runs), "--fetch-pictures", RUN]) == 0
    assert "5 pictures fetched" in capsys.readouterr().out
    assert files_in(runs / RUN / "pictures") == kept


def test_a_changed_object_is_named_and_a_missing_one(runs: Path, objects: Path) -> None:
    copy_all(runs, objects)
    drop(runs)
    copies = load_run(runs, RUN).copies
    (first, one), (second, other), *_ = copies.items()
    changed, gone = (next(objects.rglob(f"{copy.sha256}.png")) for copy in (one, other))
    changed.write_bytes(changed.read_bytes()[:-1])
    gone.unlink()
    said = {one.subject: one.problem for one in prove_run(runs, RUN).tampered}
    assert said.keys() == {first, second}
    assert "was changed or cut short" in said[first]
    assert "is not there" in said[second]
    assert "its copy is no use" in str(RunPictures(runs / RUN, copies).read(first))
    found = report_json(load_run(runs, RUN))["parts"][0]
    hashes = {
        p["file"]: p["sha256"]
        for shown in (found, *found["views"])
        for p in shown.get("table_pictures", shown.get("pictures")).values()
    }
    assert [file for file, digest in hashes.items() if digest is None] == [first, second]
    problems = RunPictures(runs / RUN, copies).bring_back(list(copies))
    assert len(problems) == 2
    assert len(pictures_of(runs)) == 3  # what is whole comes back, nothing else


def test_nothing_is_deleted_before_its_copy_was_read_back(
    runs: Path, objects: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = files_in(runs / RUN / "pictures")
    assert drop(runs) == 1  # not copied yet
    assert "5 pictures are not copied yet; they stay here" in capsys.readouterr().err
    assert files_in(runs / RUN / "pictures") == kept
    copy_all(runs, objects)
    cut = sorted(objects.rglob("*.png"))[0]
    whole = cut.read_bytes()
    cut.write_bytes(whole[:100])  # since it was copied: put right from here, not lost
    shutil.rmtree(objects / "sha256" / next(iter(load_run(runs, RUN).stored.values()))[:2])
    assert drop(runs) == 0
    assert pictures_of(runs) == []
    record = load_run(runs, RUN)
    read = RunPictures(record.folder, record.copies)
    assert {f"pictures/{name}": data for name, data in kept.items()} == {
        file: read.read(file) for file in record.copies
    }


def test_a_store_that_went_away_keeps_all_pictures_here(
    runs: Path, objects: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy_all(runs, objects)
    shutil.rmtree(objects)
    objects.write_text("a share that is gone leaves something else at its place")
    assert drop(runs) == 1
    assert "that it was not asked for stay here" in capsys.readouterr().err
    assert len(pictures_of(runs)) == 5
    with pytest.raises(ObjectsError, match=str(objects)):
        list(copy_pictures(runs, f"file://{objects}/sub", "Ann"))


def test_a_copy_that_was_cut_short_is_written_again(runs: Path, objects: Path) -> None:
    one = pictures_of(runs)[0]
    digest = hashlib.sha256(one.read_bytes()).hexdigest()
    half = objects / "sha256" / digest[:2] / f"{digest}.png"
    half.parent.mkdir(parents=True)
    half.write_bytes(one.read_bytes()[:1000])
    copy_all(runs, objects)
    assert half.read_bytes() == one.read_bytes()


def test_copying_that_was_killed_goes_on_where_it_was(
    runs: Path, objects: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put = ObjectStore.put
    calls: list[str] = []

    def killed(self: ObjectStore, path: Path, digest: str, file: str) -> None:
        if len(calls) == 2:
            raise KeyboardInterrupt
        calls.append(file)
        put(self, path, digest, file)

    monkeypatch.setattr(ObjectStore, "put", killed)
    with pytest.raises(KeyboardInterrupt):
        copy_all(runs, objects)
    assert sorted(load_run(runs, RUN).copies) == sorted(calls)  # what is proven is noted
    monkeypatch.undo()
    assert [len(one.files) for one in copy_all(runs, objects)] == [3, 5]


def test_objects_without_a_row_are_found_and_noted(
    runs: Path, objects: Path, tmp_path: Path
) -> None:
    shutil.copytree(runs, tmp_path / "twin")
    copy_all(tmp_path / "twin", objects)  # as if killed before the row: objects, and no row here
    before = {one: one.stat().st_mtime_ns for one in objects.rglob("*.png")}
    assert [len(one.files) for one in copy_all(runs, objects)] == [5, 5]
    assert {one: one.stat().st_mtime_ns for one in objects.rglob("*.png")} == before


def test_a_changed_picture_is_not_copied_under_the_old_name(
    runs: Path, objects: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = pictures_of(runs)[0]
    one.write_bytes(one.read_bytes() + b"more")
    words = ["history", "--runs", str(runs), "--copy-pictures-to", f"file://{objects}"]
    assert main(words) == 1
    assert f"{one.name}: is not as the journal has it" in capsys.readouterr().err
    assert len(load_run(runs, RUN).copies) == 4
    assert drop(runs) == 1
    assert [path.name for path in pictures_of(runs)] == [one.name]


def test_a_run_that_may_go_on_is_copied_after_it(runs: Path, objects: Path) -> None:
    writer = RunWriter(runs, "20260303-120000-000-featuretype")
    writer.look()
    found = {
        f"pictures/{one.name}": hashlib.sha256(one.read_bytes()).hexdigest()
        for one in (writer.folder / "pictures").iterdir()
    }
    writer.write(rows.FilesStored(found))
    assert [one.run for one in copy_all(runs, objects)] == [RUN, NEWER]
    writer.end()
    assert [one.run for one in copy_all(runs, objects)] == [writer.run_id]


def test_a_cell_keeps_pictures_as_its_file_asks(
    tmp_path: Path, objects: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "kept"
    folder.mkdir()
    asked = {"pictures": {"copy_to": f"file://{objects}", "keep_local_days": 30}}
    for run in (RUN, NEWER):
        cell_run(folder, run, ConnectSection.model_validate(asked))
    store = open_store(f"sqlite:///{folder}/history.sqlite")
    now = datetime.now(UTC).replace(tzinfo=None)
    try:
        fill(store, folder)
        done = list(keep_pictures(store, folder, now + timedelta(days=29), "Ann"))
        assert [(type(one), one.run) for one in done] == [(Copied, RUN), (Copied, NEWER)]
        (old,) = keep_pictures(store, folder, now + timedelta(days=31), "Ann")
        assert isinstance(old, Dropped)
        assert (old.run, len(old.files), old.problems) == (RUN, 5, ())
    finally:
        store.close()
    assert main(["history", "--runs", str(folder), "--keep-pictures", "--json"]) == 0
    assert capsys.readouterr().out == ""  # nothing more to do


def test_a_cell_that_asks_for_nothing_is_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good_run(tmp_path)
    assert main(["history", "--runs", str(tmp_path), "--keep-pictures"]) == 2
    assert "has no `connect: pictures:`" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("s3://key:secret@plant/cell", "leave keys to the environment"),
        ("s3://plant/cell?secret=1", "leave keys to the environment"),
        ("plant/cell", "must be an address of the form"),
        ("simplecache::s3://plant", "must be an address of the form"),
        ("nosuch://plant/cell", "Protocol not known: nosuch"),
    ],
)
def test_an_address_that_cannot_be_is_refused_without_its_secret(
    runs: Path, url: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["history", "--runs", str(runs), "--copy-pictures-to", url]) != 0
    said = capsys.readouterr().err
    assert why in said
    assert "secret" not in said.replace("leave keys", "")


def test_rules_that_cannot_be_read_delete_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "others"
    runs.mkdir()
    for run in (RUN, NEWER):
        cell_run(runs, run, None)
    broken = {"connect": {"pictures": {"copy_to": ["of", "tomorrow"]}}}
    row = rows.RunBegan(recipe={"name": "featuretype"}, cell=broken, count=1)
    append_beside(runs / JOURNAL_NAME, "20260304-120000-000-featuretype", row)
    assert drop(runs) != 0
    assert "no picture is copied or deleted" in capsys.readouterr().err
    assert len(pictures_of(runs)) == 5


def moto_server() -> str:
    """Return the program of moto's server; empty if it is not installed."""
    beside = Path(sys.executable).with_name("moto_server")
    return str(beside) if beside.is_file() else shutil.which("moto_server") or ""


class Bucket:
    """A server of S3 on this machine, with a bucket `plant`.

    Parameters
    ----------
    folder : for its log
    checks_keys : False to let everybody in
    """

    def __init__(self, folder: Path, *, checks_keys: bool = False) -> None:
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.port = one.getsockname()[1]
        # two requests are free, then keys count: one to see it up, one to make the bucket
        count = {"INITIAL_NO_AUTH_ACTION_COUNT": "1"} if checks_keys else {}
        self._log = (folder / "moto.log").open("wb")
        self._process = subprocess.Popen(
            [moto_server(), "-H", "127.0.0.1", "-p", str(self.port)],
            env={**os.environ, **count},
            stdout=self._log,
            stderr=self._log,
        )
        deadline = time.monotonic() + 60
        while True:
            try:
                order = urllib.request.Request(f"{self.url}/plant", method="PUT")
                urllib.request.urlopen(order, timeout=5).close()
            except OSError:
                if time.monotonic() > deadline or self._process.poll() is not None:
                    raise
                time.sleep(0.2)
            else:
                return

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(20)
        self._log.close()


@pytest.fixture
def s3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    pytest.importorskip("s3fs", reason="s3fs is not installed: pip install 'cellctl[objects]'")
    if not moto_server():
        pytest.skip("moto is not installed: pip install 'moto[server]'")
    bucket = Bucket(tmp_path)
    for name, value in (
        ("AWS_ENDPOINT_URL", bucket.url),
        ("AWS_ACCESS_KEY_ID", "testing"),
        ("AWS_SECRET_ACCESS_KEY", "testing"),
        ("AWS_DEFAULT_REGION", "eu-central-1"),
    ):
        monkeypatch.setenv(name, value)
    yield bucket
    bucket.close()


def test_pictures_go_to_a_bucket_and_come_back(
    runs: Path, s3: Bucket, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = files_in(runs / RUN / "pictures")
    to = ["history", "--runs", str(runs), "--copy-pictures-to", "s3://plant/cell-3", "--json"]
    assert main(to) == 0
    copied = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["copied"] for one in copied] == [5, 5]
    assert drop(runs) == 0
    assert pictures_of(runs) == []
    assert prove_run(runs, RUN).tampered == ()
    assert main(["history", "--runs", str(runs), "--fetch-pictures", RUN]) == 0
    assert files_in(runs / RUN / "pictures") == kept
    capsys.readouterr()
    assert main([*to[:4], "s3://nobucket/cell-3"]) == 1
    assert "s3://nobucket/cell-3" in capsys.readouterr().err
    s3.close()  # the bucket goes away: a sentence, nothing lost
    assert drop(runs) == 1
    assert "that it was not asked for stay here" in capsys.readouterr().err
    assert files_in(runs / RUN / "pictures") == kept


def test_a_wrong_key_is_a_sentence(
    runs: Path, s3: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    strict = Bucket(tmp_path, checks_keys=True)
    monkeypatch.setenv("AWS_ENDPOINT_URL", strict.url)
    try:
        words = ["history", "--runs", str(runs), "--copy-pictures-to", "s3://plant/cell-3"]
        assert main(words) == 1
    finally:
        strict.close()
    assert "access refused" in capsys.readouterr().err
    assert load_run(runs, RUN).copies == {}
