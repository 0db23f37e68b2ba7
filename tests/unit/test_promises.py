"""What earlier versions wrote is read; what they promised is still there (docs/promises.md).

What is expected was printed by the version that wrote the files, `tests/data/README.md`.
"""

from __future__ import annotations

import json
import lzma
import re
import shutil
import sqlite3
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import surface
from packaging.version import Version
from ruamel.yaml import YAML

from controller.cell.custody import CellIdentity, Custody, GripperName, fold_custody, read_folded
from controller.cell.journal import (
    JOURNAL_NAME,
    SCHEMA_VERSION,
    first_broken_row,
    first_flaw,
    open_cell_journal,
    read_row,
    read_rows,
    rows,
)
from controller.cli import main
from controller.config import load_cell, load_recipe
from controller.config.view_set import load_view_set

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data"
VERSIONS = sorted(one.name for one in DATA.iterdir() if re.fullmatch(r"\d+\.\d+\.\d+", one.name))


@dataclass(frozen=True)
class Kept:
    """A project and its folder of runs, as a version left them.

    Attributes
    ----------
    folder : of the version, for what is only read
    project : a copy that a test may change
    stated : what that version printed of it
    """

    folder: Path
    project: Path
    stated: dict[str, Any]

    @property
    def runs(self) -> Path:
        return self.project / "runs"

    @property
    def journal(self) -> Path:
        return self.runs / JOURNAL_NAME

    def json(self, capsys: pytest.CaptureFixture[str], *words: str) -> Any:
        """Run a command on these runs, and return what it prints."""
        assert main([*words, "--runs", str(self.runs)]) == 0
        return json.loads(capsys.readouterr().out)


@pytest.fixture(params=VERSIONS)
def kept(request: pytest.FixtureRequest, tmp_path: Path) -> Kept:
    folder = DATA / request.param
    project = tmp_path / "project"
    shutil.copytree(folder / "project", project)
    (project / "runs").mkdir()
    shutil.copy(folder / f"{JOURNAL_NAME}.head", project / "runs")
    for name in (JOURNAL_NAME, "part001.views.json"):
        (project / "runs" / name).write_bytes(lzma.decompress((folder / f"{name}.xz").read_bytes()))
    return Kept(folder, project, json.loads((folder / "stated.json").read_text("utf-8")))


def test_the_newest_minor_version_is_kept() -> None:
    newest = Version(
        tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    )
    assert f"{newest.major}.{newest.minor}.0" in VERSIONS, "docs/releasing.md, step 3"


def test_recipe_and_cell_file_mean_what_they_say(kept: Kept) -> None:
    written = YAML(typ="safe").load(kept.project / "recipe.yaml")
    recipe = load_recipe(kept.project / "recipe.yaml")
    assert recipe.part == kept.project / written["part"]
    assert recipe.density_g_cm3 == written["density_g_cm3"]
    assert recipe.inspection.min_coverage == written["inspection"]["min_coverage"]
    assert recipe.grasp.force_n == written["grasp"]["force_n"]
    written = YAML(typ="safe").load(kept.project / "cell.yaml")
    cell = load_cell(kept.project / "cell.yaml")
    assert cell.name == written["name"]
    assert cell.devices.gripper.unit == written["devices"]["gripper"]["unit"]
    assert list(cell.trays.accept.centre) == written["trays"]["accept"]["centre"]


def test_a_set_of_views_is_read(kept: Kept) -> None:
    views = load_view_set(kept.runs / "part001.views.json")
    assert len(views.views) == kept.stated["views"]


def test_every_row_is_read_and_fits_the_chain(kept: Kept) -> None:
    assert first_flaw(kept.journal) is None
    assert first_broken_row(kept.journal) is None
    read = list(read_rows(kept.journal))
    assert len(read) == kept.stated["rows"]
    for row in read:
        # raises where a body is not as its model has it
        assert read_row(row.kind, row.name, row.body) is not None, (row.kind, row.name)


def test_a_later_version_brings_the_file_up_to_date_and_changes_no_row(kept: Kept) -> None:
    before = list(read_rows(kept.journal))
    opened = open_cell_journal(kept.journal, "later")
    assert opened.notice == ""
    opened.journal.write_synced(
        rows.Acknowledged(run=kept.stated["killed"], code="door", who="Ada", why="it is closed")
    )
    opened.journal.close()
    after = list(read_rows(kept.journal))
    assert after[: len(before)] == before
    assert len(after) == len(before) + 1
    assert first_broken_row(kept.journal) is None


def test_the_report_has_the_values_that_were_reported(
    kept: Kept, capsys: pytest.CaptureFixture[str]
) -> None:
    stated = kept.stated["report"]
    report = kept.json(capsys, "report", kept.stated["run"], "--format", "json")
    assert report["verdict"] == stated["verdict"]
    assert report["software"]["cellctl"] == kept.folder.name
    (now,), (then,) = report["parts"], stated["parts"]
    for key in ("serial", "lot", "verdict", "tray", "custody", "covered_fraction"):
        assert now[key] == then[key], key
    values = [
        [
            {key: one.get(key) for key in ("id", "measured", "U", "verdict")}
            for one in characteristics
        ]
        for characteristics in (now["characteristics"], then["characteristics"])
    ]
    assert values[0] == values[1]


def test_the_history_lists_the_part(kept: Kept, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["history", "--json", "--serial", "A0001", "--runs", str(kept.runs)]) == 0
    part, end = map(json.loads, capsys.readouterr().out.splitlines())
    assert end["count"] == 1
    (stated,) = kept.stated["report"]["parts"]
    assert (part["verdict"], part["tray"]) == (stated["verdict"], stated["tray"])
    assert part["compared_fraction"] == stated["covered_fraction"]


def test_a_part_that_a_killed_run_left_in_the_arm_gripper_is_known(kept: Kept) -> None:
    killed = kept.stated["killed"]
    began = next(row for row in read_rows(kept.journal, killed) if row.name == "run_began")
    here = CellIdentity.of(rows.RunBegan.model_validate(began.body))
    (held,) = fold_custody(read_folded(kept.journal), here)
    assert (held.gripper, held.run) == (GripperName.ARM, killed)
    assert held.custody in {Custody.IN_ARM, Custody.UNKNOWN}


def test_the_journal_of_a_newer_version_is_refused_and_left_as_it_is(
    kept: Kept, capsys: pytest.CaptureFixture[str]
) -> None:
    with sqlite3.connect(kept.journal) as db:
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    db.close()
    before = kept.journal.read_bytes()
    assert main(["report", "--format", "json", "--runs", str(kept.runs)]) != 0
    assert "Use the cellctl that wrote it" in capsys.readouterr().err
    assert kept.journal.read_bytes() == before


@pytest.fixture(scope="module")
def there() -> dict[str, list[str]]:
    return surface.surface()


@pytest.mark.parametrize("version", VERSIONS)
def test_what_was_promised_is_there(version: str, there: dict[str, list[str]]) -> None:
    promised = json.loads((DATA / version / "surface.json").read_text("utf-8"))
    assert sum(map(len, promised.values())) > 1000
    assert surface.missing(promised, there) == [], "docs/promises.md says when that may be"


def test_a_promise_that_is_broken_is_named(there: dict[str, list[str]]) -> None:
    promised = {"commands": ["run", "run --fly"], "wings": ["two"]}
    assert surface.missing(promised, there) == ["commands: run --fly", "wings: two"]
