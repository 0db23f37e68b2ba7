"""The page's *Cell*: what files and journal say of it, its pictures measured, the doctor's lock."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import CELL, HERE, RUN, Bench, bench, journal

from controller.bring_up.procedure import StepEnd, StepRecord, cell_digest
from controller.cell.journal import JOURNAL_NAME, rows
from controller.cell.lock import hold_cell
from controller.config import SHIPPED, Cell, load_cell, load_yaml
from controller.config.calibrations import TraysCalibration, write_calibration
from controller.page import cell as cell_screen
from controller.page.cell.cells import CellFiles, History, Past, cell_facts, evidence, read_past
from controller.page.cell.pictures import LastPictures, measures_of
from controller.page.security import Role
from controller.page.work import Workshop

NOW = datetime(2026, 11, 27, 12, 0, tzinfo=UTC)
DOCTOR = """
import json, pathlib, sys
if "--pictures" in sys.argv:
    import cv2, numpy
    name = "overhead-table_ring-000007.png"
    folder = pathlib.Path(sys.argv[sys.argv.index("--pictures") + 1])
    cv2.imwrite(str(folder / name), numpy.full((20, 30), 77, numpy.uint8))
    found = {"event": "picture", "camera": "overhead", "lamp": "table_ring", "file": name}
    print(json.dumps(found))
    raise SystemExit(0)
print(json.dumps({"check": "arm", "ok": False, "found": " ".join(sys.argv[1:]), "remedy": "r"}))
raise SystemExit(1)
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    shutil.copy(CELL, tmp_path / "cell.yaml")
    return tmp_path


def facts(project: Path, past: Past | None = None) -> dict[str, Any]:
    files = CellFiles(project)
    file = files.find("")
    assert file is not None
    return cell_facts(files, file, past or Past({}), NOW)


def calibrated(project: Path, measured: datetime) -> None:
    """Give the cell a calibration of its trays that is valid for ten days."""
    trays = load_cell(project / "cell.yaml").trays
    centres = {name: tray["centre"] for name, tray in trays.model_dump().items()}
    made = TraysCalibration.model_validate(
        {
            "schema": 1,
            "measured": measured,
            "by": "Ada",
            "valid_days": 10,
            "u_mm": 0.1,
            "centres": centres,
            "kind": TraysCalibration.model_fields["kind"].default,
        }
    )
    digest = write_calibration(project / "calibrations" / "trays.json", made)
    with (project / "cell.yaml").open("a") as file:
        file.write(
            f"calibration:\n  trays: {{file: calibrations/trays.json, sha256: '{digest}'}}\n"
        )


def test_cell_files_are_found_and_the_recipes_comes_first(project: Path) -> None:
    (project / "cells").mkdir()
    shutil.copy(CELL, project / "cells" / "b.yaml")
    (project / "broken.yaml").write_text("devices: [\n")
    shutil.copytree(SHIPPED / "parts", project / "parts")
    recipe = (SHIPPED / "holder.yaml").read_text().replace("cells/emulated.yaml", "cells/b.yaml")
    (project / "recipe.yaml").write_text(recipe)
    files = CellFiles(project)
    keys = [one.key for one in files.all()]
    assert keys[:2] == ["project/cells/b.yaml", "project/cell.yaml"]
    assert "shipped/emulated.yaml" in keys
    assert files.find("project/../cell.yaml") is None
    assert files.find("project/recipe.yaml") is None


def test_devices_have_their_addresses_and_what_they_last_said(project: Path) -> None:
    writer = journal(project / "runs")
    writer.write(rows.Connected({"arm": "UMI RTX, 4.2"}))
    writer.close()
    past = read_past(project / "runs" / JOURNAL_NAME)
    assert past.connected_run == RUN
    devices = {one["name"]: one for one in facts(project, past)["devices"]}
    assert set(devices) == set(type(load_cell(CELL).devices).model_fields)
    assert devices["arm"]["said"] == "UMI RTX, 4.2"
    assert devices["arm"]["is_emulated"]
    assert devices["gripper"]["said"] == ""


def test_a_calibration_has_its_age_and_says_why_it_no_longer_counts(project: Path) -> None:
    assert facts(project)["calibrations"] == []
    calibrated(project, NOW - timedelta(days=9.5))
    [young] = facts(project)["calibrations"]
    assert young["age_days"] == pytest.approx(9.5)
    assert (young["by"], young["why_stale"]) == ("Ada", "")
    files = CellFiles(project)
    file = files.find("project/cell.yaml")
    assert file is not None
    later = cell_facts(files, file, Past({}), NOW + timedelta(days=1))
    assert "valid for 10 days" in later["calibrations"][0]["why_stale"]
    assert later["why_not_verified"]
    (project / "calibrations" / "trays.json").write_text("{}")
    assert "has changed" in facts(project)["problem"]


def test_steps_of_commissioning_and_their_evidence_are_listed_and_nothing_else(
    project: Path,
) -> None:
    assert {one["status"] for one in facts(project)["steps"]} == {"not done"}
    cell = load_yaml(project / "cell.yaml", Cell).read_from(project / "cell.yaml")
    files = CellFiles(project)
    file = files.find("project/cell.yaml")
    assert file is not None
    folder = files.commissioned(file, cell)
    made = folder.begin_evidence("devices", NOW)
    record = StepRecord.model_validate(
        {
            "schema": 1,
            "step": "devices",
            "began": NOW - timedelta(hours=1),
            "ended": NOW,
            "by": "Ada",
            "outcome": StepEnd.PASSED,
            "cell_digest": cell_digest(cell),
            "evidence": str(made.relative_to(folder.path)),
        }
    )
    folder.write_record(record)
    (made / "a.png").write_bytes(b"png")
    (made / "secret.key").write_text("no")
    steps = {one["step"]: one for one in facts(project)["steps"]}
    assert steps["devices"]["status"] == "done"
    assert "Ada" in steps["devices"]["reason"]
    names = [Path(name).name for name in evidence(folder)]
    assert sorted(names) == ["a.png", "record.json"]


def test_the_whole_journal_is_read_once_a_minute_at_most(project: Path) -> None:
    writer = journal(project / "runs")
    now_s = [0.0]
    history = History(project / "runs", lambda: now_s[0])
    assert history.past().connected is None
    writer.write(rows.Connected({"arm": "here"}))
    writer.close()
    assert history.past().connected is None
    now_s[0] = 60.0
    assert history.past().connected == {"arm": "here"}


def test_a_picture_out_of_focus_has_the_lesser_figure() -> None:
    rng = np.random.default_rng(1)
    sharp = rng.integers(60, 200, (240, 320)).astype(np.uint8)
    figures = [
        measures_of(np.asarray(cv2.GaussianBlur(sharp, (0, 0), sigma), dtype=np.uint8))["focus"]
        for sigma in (0.5, 1.0, 2.0, 4.0)
    ]
    assert figures == sorted(figures, reverse=True)
    half = np.zeros((10, 10), np.uint8)
    half[:5] = 255
    found = measures_of(half)
    assert (found["dark"], found["bright"], found["mean"]) == (0.5, 0.5, 127.5)
    assert (found["histogram"][0], found["histogram"][-1]) == (0.5, 0.5)
    assert sum(found["histogram"]) == pytest.approx(1.0)
    brighter = measures_of(np.full((8, 8), 7, np.uint8))
    assert brighter["histogram"][1] == 1.0


def test_the_last_pictures_are_those_of_the_newest_rows(project: Path) -> None:
    runs = project / "runs"
    last = LastPictures(runs)
    assert last.facts() == {"run": "", "pictures": [], "problem": ""}
    writer = journal(runs)
    (runs / RUN / "p").mkdir(parents=True)
    for name in ("t.png", "a.png", "b.png"):
        cv2.imwrite(str(runs / RUN / "p" / name), np.full((20, 30), 90, np.uint8))
    writer.write(rows.TablePictures({"backlight": "p/t.png"}), 1)
    for view, name in (("V1", "a"), ("V2", "b")):
        taken = {"ring": f"p/{name}.png"}
        writer.write(rows.ViewPicturesTaken(view=view, pictures=taken, q=HERE), 1)
    found = last.facts()["pictures"]
    assert [(one["camera"], one["view"]) for one in found] == [
        ("overhead", ""),
        ("inspection", "V2"),
    ]
    assert all(one["measured"]["mean"] == 90 for one in found)
    out = {"ring": "../../journal.sqlite", "side": "p/none.png"}
    writer.write(rows.ViewPicturesTaken(view="V3", pictures=out, q=HERE), 1)
    writer.close()
    assert [one["measured"] for one in last.facts()["pictures"]][1:] == [None, None]
    assert last.file(1) is None
    assert last.file(7) is None


@pytest.fixture
def page(project: Path) -> Iterator[Bench]:
    shop = Workshop((sys.executable, "-c", DOCTOR))
    with patch.object(cell_screen, "Workshop", lambda **_: shop):
        found = bench(project)
    with found.client:
        yield found


def post(page: Bench, path: str, body: object, csrf: str) -> tuple[int, dict[str, Any]]:
    status, text = page.post(f"/cell/{path}", body, csrf)
    return status, json.loads(text)


def test_only_an_engineer_has_devices_examined_and_never_while_a_run_is_on(
    page: Bench, project: Path
) -> None:
    asked = {"cell": "project/cell.yaml"}
    for role in (Role.VIEWER, Role.OPERATOR):
        csrf = page.log_in(role)
        assert post(page, "examine", asked, csrf)[0] == 403
        assert 'id="examine"' not in page.client.get("/cell").text
    csrf = page.log_in(Role.ENGINEER)
    assert post(page, "examine", asked, "forged")[0] == 403
    with hold_cell(project / "runs", load_cell(CELL), "the-run"):
        status, refusal = post(page, "examine", asked, csrf)
        assert (status, "the-run" in refusal["error"]) == (409, True)
        assert "the-run" in page.client.get("/cell/facts").json()["holder"]
    assert post(page, "examine", {"cell": "project/none.yaml"}, csrf)[0] == 404
    assert post(page, "examine", asked, csrf)[0] == 200
    while (found := page.client.get("/cell/doctor?cell=project/cell.yaml").json())["running"]:
        pass
    [check] = found["checks"]
    words = check["found"].split()
    assert words[:2] == ["doctor", "--cell"]
    assert words[words.index("--runs") + 1] == str(project / "runs")  # whose lock it holds


def test_an_engineer_sees_what_the_cameras_see_with_its_measures(
    page: Bench, project: Path
) -> None:
    asked = {"cell": "project/cell.yaml"}
    csrf = page.log_in(Role.OPERATOR)
    assert post(page, "watch", asked, csrf)[0] == 403
    assert page.client.get("/cell/live").status_code == 403
    csrf = page.log_in(Role.ENGINEER)
    assert page.client.get("/cell/live").json()["pictures"] == []
    with hold_cell(project / "runs", load_cell(CELL), "the-run"):
        assert post(page, "watch", asked, csrf)[0] == 409
    assert post(page, "watch", asked, csrf)[0] == 200
    while (found := page.client.get("/cell/live").json())["work"]["state"] == "running":
        pass
    [one] = found["pictures"]
    assert (one["lamp"], one["measured"]["mean"]) == ("table_ring", 77)
    reply = page.client.get(f"/cell/live/{one['file']}")
    assert (reply.status_code, reply.headers["content-type"]) == (200, "image/jpeg")
    for name in ("out.jsonl", "overhead-table_ring-000008.png", "..%2Fx.png"):
        assert page.client.get(f"/cell/live/{name}").status_code == 404


def test_evidence_comes_as_a_file_to_keep_and_no_other_file_comes(
    page: Bench, project: Path
) -> None:
    folder = project / "commissioning" / load_cell(CELL).name
    (folder / "evidence" / "d").mkdir(parents=True)
    (folder / "evidence" / "d" / "record.json").write_text("{}")
    (folder / "steps.json").write_text("{}")
    page.log_in(Role.VIEWER)
    reply = page.client.get("/cell/evidence", params={"name": "evidence/d/record.json"})
    assert reply.status_code == 200
    assert reply.headers["content-disposition"].startswith("attachment;")
    for name in ("steps.json", "../../cell.yaml", "evidence/d/../../steps.json", ""):
        assert page.client.get("/cell/evidence", params={"name": name}).status_code == 404


def test_the_page_is_there_in_both_languages(page: Bench) -> None:
    page.log_in(Role.VIEWER)
    assert "Calibrations" in page.client.get("/cell?lang=en").text
    assert "Kalibrierungen" in page.client.get("/cell?lang=de").text
    assert json.dumps(page.client.get("/cell/facts").json())
    assert page.client.get("/cell/facts?cell=none").status_code == 404
