"""A central page: it has no runs of its own, several cells fill its store."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import Bench, bench
from results_bench import RunWriter, finding, verdict, view

from controller.cell.batch import Papers
from controller.cell.journal import JOURNAL_NAME, read_rows, rows
from controller.history import VARIABLE, fill, open_store
from controller.history.keeping import copy_pictures
from controller.inspection import Verdict
from controller.page.records import records as records_module
from controller.page.security import Role
from drivers.pictures import decode

RUN = "20260301-120000-000-featuretype"
BORE = rows.CharacteristicFields(
    id="d1", balloon=1, kind="diameter", label="bore 8", nominal=8.0, lower=7.9, upper=8.1,
    source="recipe", measured=8.01, U=0.02, verdict="pass",
)  # fmt: skip
LEVELS = {"cell-1": 60, "cell-2": 90, "cell-3": 120}


@dataclass
class Cells:
    """Three cells with one run of one id each: the first two copy their pictures, the last not."""

    folder: Path
    at: Bench

    def runs(self, cell: str) -> Path:
        return self.folder / cell

    @property
    def objects(self) -> Path:
        return self.folder / "objects"


def write(folder: Path, cell: str) -> None:
    """Write a cell's run: a finding, a dimension, pictures as bright as no other cell's."""
    folder.mkdir()
    writer = RunWriter(folder, RUN, papers=Papers(serials=(f"SN-{cell}",)), cell_name=cell)
    writer.look()
    writer.plan()
    writer.grasp()
    seen = view("G1-V0", finding())
    writer.show("show with grasp G1", seen, 4.0)
    writer.judge_view(seen)
    value = BORE.model_copy(update={"measured": 8.0 + LEVELS[cell] / 10_000})
    writer.write(rows.PartMeasured(characteristics=(value,)))
    writer.judge(verdict(Verdict.INDETERMINATE))
    writer.place("quarantine")
    stored = {}
    for path in sorted((writer.folder / "pictures").iterdir()):
        image = np.full((64, 80), LEVELS[cell], np.uint8)
        cv2.imwrite(str(path), image)
        stored[f"pictures/{path.name}"] = hashlib.sha256(path.read_bytes()).hexdigest()
    writer.write(rows.FilesStored(stored))
    writer.end()


@pytest.fixture
def cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cells]:
    url = f"sqlite:///{tmp_path}/central.sqlite"
    monkeypatch.setenv(VARIABLE, url)
    # what the page's own process does is done in a thread here
    monkeypatch.setattr(records_module, "make_pool", lambda: ThreadPoolExecutor(1))
    monkeypatch.setattr(records_module, "WAIT_S", 60.0)
    store = open_store(url)
    for cell in LEVELS:
        write(tmp_path / cell, cell)
        fill(store, tmp_path / cell)
        if cell != "cell-3":
            list(copy_pictures(tmp_path / cell, f"file://{tmp_path}/objects", "Ann"))
            fill(store, tmp_path / cell)  # the copies are noted after the part
    store.close()
    found = bench(tmp_path)  # its folder of runs is not there
    with found.client:
        found.log_in(Role.OPERATOR)
        yield Cells(tmp_path, found)


def page(cells: Cells, path: str, status: int = 200) -> str:
    reply = cells.at.client.get(path)
    assert reply.status_code == status, reply.text[:300]
    return str(reply.text)


def test_the_list_has_the_parts_of_all_cells_and_chooses_one_cell(cells: Cells) -> None:
    text = page(cells, "/history")
    assert [f"<td>{cell}</td>" in text for cell in LEVELS] == [True] * 3
    text = page(cells, "/history?cell=cell-2")
    assert "Parts: 1" in text
    assert "SN-cell-2" in text
    assert "SN-cell-1" not in text
    assert f'href="/history/part/cell-2/{RUN}/1"' in text


def test_a_part_of_each_cell_shows_its_findings_values_and_pictures(cells: Cells) -> None:
    for cell in ("cell-1", "cell-2"):
        text = page(cells, f"/history/part/{cell}/{RUN}/1")
        assert f"<dd>{cell}</dd>" in text
        assert "missing material" in text
        assert f"{8.0 + LEVELS[cell] / 10_000:.3f}" in text
        for number in range(5):
            reply = cells.at.client.get(f"/history/picture/{cell}/{RUN}/1/{number}")
            assert reply.headers["content-type"] == "image/jpeg"
            shown = np.asarray(decode(reply.content, "grey"))
            assert abs(float(shown.mean()) - LEVELS[cell]) < 2  # of this cell, not of another
    assert cells.at.client.get(f"/history/picture/cell-1/{RUN}/1/5").status_code == 404


def test_a_part_whose_pictures_were_not_copied_says_where_they_are(cells: Cells) -> None:
    text = page(cells, f"/history/part/cell-3/{RUN}/1")
    assert "missing material" in text
    assert "no copies were made" in text
    assert cells.at.client.get(f"/history/picture/cell-3/{RUN}/1/0").status_code == 404


def test_a_changed_copy_is_not_shown_and_said(cells: Cells) -> None:
    for one in cells.objects.rglob("*.png"):
        one.write_bytes(one.read_bytes() + b"more")
    reply = cells.at.client.get(f"/history/picture/cell-1/{RUN}/1/0")
    assert reply.status_code == 404
    assert "was changed or cut short" in reply.text


def test_a_folder_of_the_same_name_is_not_taken_for_another_cells(cells: Cells) -> None:
    # this machine has a cell of its own by now, whose run has the same id
    shutil.copytree(cells.runs("cell-3"), cells.folder / "runs")
    reply = cells.at.client.get(f"/history/picture/cell-1/{RUN}/1/0")
    assert abs(float(np.asarray(decode(reply.content, "grey")).mean()) - LEVELS["cell-1"]) < 2
    reply = cells.at.client.get(f"/history/picture/cell-3/{RUN}/1/0")  # from its own folder
    assert abs(float(np.asarray(decode(reply.content, "grey")).mean()) - LEVELS["cell-3"]) < 2


def test_reviews_and_reports_are_made_where_the_journal_is(cells: Cells) -> None:
    assert "SN-cell-1" in page(cells, "/review")
    text = page(cells, f"/review/part/cell-1/{RUN}/1")
    assert "missing material" in text
    reply = cells.at.client.get(f"/review/crop/cell-1/{RUN}/1/1/picture")
    assert reply.status_code == 404
    assert "the journal of this part is not here" in reply.text
    assert "not here" in page(cells, f"/history/file/cell-1/{RUN}/1/html", 409)
    body = {"run": f"cell-1/{RUN}", "number": 1, "verdict": "accept", "why": "dust", "seen": 0}
    status, said = cells.at.post("/review/decide", body, cells.at.csrf())
    assert status == 409
    assert "of cell cell-1, whose journal is not in" in said
    for cell in LEVELS:
        found = read_rows(cells.runs(cell) / JOURNAL_NAME)
        assert not any(row.name == "part_reviewed" for row in found)
    assert cells.at.client.get("/history/file/csv?cell=cell-2").text.count("SN-cell-2") == 1
