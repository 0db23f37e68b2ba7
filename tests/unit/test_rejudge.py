"""`cellctl rejudge`: an archive judged anew, interrupted, spread over processes, with a hole."""

from __future__ import annotations

import csv
import hashlib
import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import archive_copies
import dask_processes
import postgres_server
import pytest
import sqlalchemy
import stored_run

from controller.catalogue import PoolLostError
from controller.cell.journal import JOURNAL_NAME, Body, rows
from controller.cli import main
from controller.cli.history import rejudging
from controller.history import open_store
from controller.history.keeping import copy_pictures
from controller.history.rejudging import ArchivedPart, Rejudged
from controller.history.tables import PARTS, REJUDGED

COUNT = 3
# beyond it lie 30.26 +- 0.35 mm, which the recipe of the run left open
STRICTER = """
name: shown
part: shown.stl
inspection:
  min_coverage: 0.1
  characteristics:
    - {id: length 30 mm F0 to F10, lower: 25, upper: 29}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recipe and an archive of runs with a part each; tests copy it."""
    folder = tmp_path_factory.mktemp("made")
    stored_run.write(folder / "first")
    archive_copies.copy_run(folder / "first", stored_run.RUN, folder / "runs", range(COUNT))
    shutil.copy(folder / "first" / stored_run.RUN / "inputs/shown.stl", folder)
    (folder / "new.yaml").write_text(STRICTER, encoding="utf-8")
    shutil.rmtree(folder / "first")
    return folder


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[ArchivedPart]:
    """Parts whose verdict is a pass at once, for what is not of the pictures."""
    found: list[ArchivedPart] = []

    def passed(part: ArchivedPart) -> Rejudged:
        found.append(part)
        return Rejudged(verdict="pass", reasons=("as it is",), lines_sha256=f"{part.part_id:064d}")

    monkeypatch.setattr(rejudging, "rejudge", passed)
    return found


def rejudge(*words: str) -> int:
    return main(["rejudge", "--recipe", "new.yaml", *words])


def table(name: str = "turned.csv") -> list[dict[str, str]]:
    with Path(name).open(encoding="utf-8-sig", newline="") as file:
        return list(csv.DictReader(file))


def kept(store: str = "sqlite:///runs/history.sqlite") -> list[Any]:
    opened = open_store(store)
    try:
        with opened.reading() as db:
            return list(db.execute(sqlalchemy.select(REJUDGED).order_by(REJUDGED.c.part_id)))
    finally:
        opened.close()


def test_a_stricter_recipe_turns_parts_and_says_by_what(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = hashlib.sha256((here / "runs" / JOURNAL_NAME).read_bytes()).digest()
    assert rejudge("-o", "turned.csv", "--json") == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["event"] for line in lines] == ["turned"] * COUNT + ["rejudged"]
    assert lines[-1]["turned"] == {"indeterminate -> fail": COUNT}
    found = table()
    assert [row["serial"] for row in found] == [f"SN-{n:05d}" for n in range(COUNT)]
    assert {(row["was"], row["now"], row["turned"]) for row in found} == {
        ("indeterminate", "fail", "yes")
    }
    was = r"length 30 mm F0 to F10: indeterminate \(30\.\d+ \+- 0\.\d+ in "
    assert re.match(was, found[0]["why"])
    assert re.search(r"-> fail \(30\.\d+ \+- 0\.\d+ in 25\.000 to 29\.000\)$", found[0]["why"])
    # the journal is the evidence of what the cell did, and of nothing else
    assert hashlib.sha256((here / "runs" / JOURNAL_NAME).read_bytes()).digest() == before
    assert len(kept()) == COUNT
    # processes of their own find the same, to the last bit of every number
    assert rejudge("-o", "two.csv", "--jobs", "2", "--store", f"sqlite:///{here}/two.sqlite") == 0
    assert (here / "two.csv").read_bytes() == (here / "turned.csv").read_bytes()
    assert [row.lines_sha256 for row in kept(f"sqlite:///{here}/two.sqlite")] == [
        row.lines_sha256 for row in kept()
    ]


@pytest.mark.slow
def test_a_cluster_whose_workers_and_scheduler_are_killed_finds_the_same(
    here: Path, made: Path
) -> None:
    first = sorted(p.name for p in (made / "runs").glob("2026*"))[0]
    archive_copies.copy_run(made / "runs", first, here / "many", range(100, 116))
    assert (
        rejudge("--runs", "many", "-o", "one.csv", "--store", f"sqlite:///{here}/one.sqlite") == 0
    )
    killed = dask_processes.rejudge_with_kills(
        ["rejudge", "--recipe", "new.yaml", "--runs", "many", "-o", "cluster.csv"],
        here / "many" / "history.sqlite",
        [2, 4, 6],
    )
    assert killed.first_code == 1
    assert "went away" in killed.first_error
    assert "are judged and kept: the same command goes on" in killed.first_error
    assert {"workers: 2 of 2", "workers: 1 of 2"} <= killed.workers
    assert killed.second_code == 0, killed.second_error
    assert (here / "cluster.csv").read_bytes() == (here / "one.csv").read_bytes()


def test_parts_with_a_missing_or_changed_picture_are_named_and_the_rest_goes_on(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = sorted((here / "runs").glob("2026*"))
    lost, changed = (run / "pictures/v02_ring.png" for run in runs[1:3])
    lost.unlink()
    other = (runs[2] / "pictures/v01_ring.png").read_bytes()
    changed.unlink()
    changed.write_bytes(other)
    assert rejudge("-o", "turned.csv") == 1
    err = capsys.readouterr().err
    assert f"{runs[1].name}/1 is not judged" in err
    assert "v02_ring.png: No such file" in err
    assert f"{runs[2].name}/1 is not judged" in err
    assert "v02_ring.png: was changed since the run" in err
    assert [row["now"] for row in table()] == ["fail", "not judged", "not judged"]
    # once the picture is there again, only these two are tried
    lost.write_bytes((runs[0] / "pictures/v02_ring.png").read_bytes())
    assert rejudge("-o", "turned.csv") == 1
    assert [row["now"] for row in table()] == ["fail", "fail", "not judged"]


@pytest.mark.usefixtures("here")
def test_an_interrupted_command_goes_on_where_it_stopped(
    quick: list[ArchivedPart], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rejudge("-o", "whole.csv", "--store", "sqlite:///whole.sqlite") == 0
    quick.clear()
    judge = rejudging.rejudge

    def interrupted(part: ArchivedPart) -> Rejudged:
        if len(quick) == 2:
            raise KeyboardInterrupt
        return judge(part)

    monkeypatch.setattr(rejudging, "rejudge", interrupted)
    assert rejudge() == 130
    monkeypatch.setattr(rejudging, "rejudge", judge)
    capsys.readouterr()
    assert rejudge("-o", "turned.csv") == 0
    assert len({part.part_id for part in quick}) == len(quick) == COUNT
    assert "judged so already: 2 of 3 parts" in capsys.readouterr().err
    assert Path("turned.csv").read_bytes() == Path("whole.csv").read_bytes()


@pytest.mark.usefixtures("here")
def test_a_pool_that_ends_keeps_what_it_had_done(
    quick: list[ArchivedPart], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = rejudging.results_of

    def ends(pool: Any, call: Callable[..., Any], orders: Iterator[Any]) -> Iterator[Any]:
        results = whole(pool, call, orders)
        yield from (next(results) for _ in range(2))
        raise PoolLostError("the Dask scheduler at tcp://here:1 went away")

    with monkeypatch.context() as patch:
        patch.setattr(rejudging, "results_of", ends)
        assert rejudge() == 1
    err = capsys.readouterr().err
    assert "went away; 2 of 3 parts are judged and kept: the same command goes on" in err
    assert rejudge() == 0
    assert len(quick) == COUNT


@pytest.mark.usefixtures("here")
def test_another_recipe_or_another_cellctl_is_judged_anew(
    quick: list[ArchivedPart], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert rejudge() == rejudge() == 0
    assert len(quick) == COUNT
    Path("new.yaml").write_text(STRICTER.replace("29", "28"), encoding="utf-8")
    assert rejudge() == 0
    monkeypatch.setattr(
        "controller.history.rejudging.archive.software_key", lambda: "0.0.9 of before"
    )
    assert rejudge() == 0
    assert len(quick) == len(kept()) == 3 * COUNT


@pytest.mark.usefixtures("here")
def test_what_was_judged_anew_outlives_a_refill(quick: list[ArchivedPart]) -> None:
    assert rejudge() == 0
    before = kept()
    assert main(["history", "--refill", "--runs", "runs"]) == 0
    assert kept() == before
    assert rejudge() == 0
    assert len(quick) == COUNT


def test_a_part_that_left_the_journal_takes_its_new_verdict_along(
    here: Path, made: Path, quick: list[ArchivedPart]
) -> None:
    assert rejudge() == 0
    (here / "runs" / JOURNAL_NAME).unlink()
    first = sorted(path.name for path in (here / "runs").glob("2026*"))[0]
    shutil.rmtree(here / "runs")
    archive_copies.copy_run(made / "runs", first, here / "runs", range(1))
    # another journal: its part has another key, and the old ones stay with theirs
    shutil.copy(made / "runs" / JOURNAL_NAME, here / "runs" / JOURNAL_NAME)
    assert rejudge() == 0
    assert len(quick) == 2 * COUNT


@pytest.mark.usefixtures("here")
def test_days_and_lots_choose_the_parts(
    quick: list[ArchivedPart], capsys: pytest.CaptureFixture[str]
) -> None:
    assert rejudge("--since", "2000-01-01", "--lot", "L7") == 0
    assert len(quick) == COUNT
    for words in (("--until", "2000-01-01"), ("--since", "2999-01-01"), ("--lot", "L8")):
        assert rejudge(*words) == 2
    assert "no judged part of shown fits; the store has parts of: shown" in capsys.readouterr().err


@pytest.mark.usefixtures("quick")
def test_parts_of_another_folder_in_the_same_store_are_left_to_it(
    here: Path, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive_copies.copy_run(
        made / "runs", sorted(p.name for p in (made / "runs").glob("2026*"))[0],
        here / "others", range(7000, 7002),
    )  # fmt: skip
    store = f"sqlite:///{here}/plant.sqlite"
    assert main(["history", "--runs", "others", "--store", store]) == 0
    assert rejudge("--store", store) == 0
    assert "2 parts of runs in other folders are left out" in capsys.readouterr().err
    assert len(kept(store)) == COUNT


@pytest.mark.usefixtures("here")
def test_a_store_of_before_gets_the_table(quick: list[ArchivedPart]) -> None:
    assert main(["history", "--runs", "runs"]) == 0
    store = open_store("sqlite:///runs/history.sqlite")
    with store.engine.begin() as db:
        REJUDGED.drop(db)
        db.execute(sqlalchemy.text("UPDATE store_version SET version = 6"))
        assert (
            db.execute(sqlalchemy.select(sqlalchemy.func.count(PARTS.c.part_id))).scalar() == COUNT
        )
    store.close()
    assert rejudge() == 0
    assert len(quick) == len(kept()) == COUNT


@pytest.mark.usefixtures("here")
def test_postgresql_keeps_it_alike(quick: list[ArchivedPart]) -> None:
    why = postgres_server.missing()
    if why:
        pytest.skip(why)
    assert rejudge("-o", "lite.csv") == 0
    with postgres_server.server() as url:
        assert rejudge("-o", "post.csv", "--store", url) == 0
        assert rejudge("-o", "post.csv", "--store", url) == 0
    assert Path("post.csv").read_bytes() == Path("lite.csv").read_bytes()
    assert len(quick) == 2 * COUNT


@pytest.mark.usefixtures("here", "quick")
def test_a_pass_names_what_it_was_judged_by_before() -> None:
    assert rejudge("-o", "turned.csv") == 0
    why = table()[0]["why"]
    was = r"length 30 mm F0 to F10: indeterminate \(30\.\d+ \+- 0\.\d+ in 29\.800 to"
    assert re.match(was, why)
    assert "34 mm" not in why  # which had passed


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("name", ["turned.txt", "runs"])
def test_the_table_is_a_csv_file(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert rejudge("-o", name) == 2
    assert "name a file that ends in .csv" in capsys.readouterr().err


def unjudged(number: int, body: Body) -> Body:
    return (
        body.model_copy(update={"views": "gone.json"})
        if isinstance(body, rows.PartInspected)
        else body
    )


def test_a_part_without_its_file_of_views_is_named(
    here: Path, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = sorted(p.name for p in (made / "runs").glob("2026*"))[0]
    archive_copies.copy_run(made / "runs", first, here / "few", range(1), unjudged)
    assert rejudge("--runs", "few") == 1
    assert "gone.json" in capsys.readouterr().err


def test_pictures_that_are_only_in_a_store_of_objects_are_judged_alike(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rejudge("-o", "here.csv", "--store", f"sqlite:///{here}/here.sqlite") == 0
    objects = here / "objects"
    list(copy_pictures(here / "runs", f"file://{objects}", "Ann"))
    runs = sorted((here / "runs").glob("2026*"))
    for run in runs:
        shutil.rmtree(run / "pictures")
    assert rejudge("-o", "objects.csv") == 0
    assert Path("objects.csv").read_bytes() == Path("here.csv").read_bytes()
    assert [row.lines_sha256 for row in kept()] == [
        row.lines_sha256 for row in kept(f"sqlite:///{here}/here.sqlite")
    ]
    assert not any((run / "pictures").exists() for run in runs)  # nothing came back
    one = next(objects.rglob("*.png"))
    one.write_bytes(one.read_bytes()[:-1])
    capsys.readouterr()
    assert rejudge("-o", "cut.csv", "--store", f"sqlite:///{here}/cut.sqlite") == 1
    assert "was changed or cut short" in capsys.readouterr().err
