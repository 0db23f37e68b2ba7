"""A run on the disk whose part was judged from stored views: journal, pictures, their file."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import view_sets

from controller.cell.journal import JOURNAL_NAME, Journal, rows
from controller.cell.services.records import findings_row, measured_row, verdict_row
from controller.config.view_set import load_view_set
from controller.stored import Judging, compiled_part, judge_views, lines_digest, read_pictures

RUN = "20260314-092641-512-shown"


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write(runs: Path) -> Path:
    """Write a run as the cell leaves it; return its folder."""
    folder = runs / RUN
    tree = view_sets.tree()
    tree["part"] = "inputs/shown.stl"
    tree["recipe"] = {"name": "shown", "part": "shown.stl", "inspection": {"min_coverage": 0.1}}
    for view in tree["views"]:
        view["pictures"] = {lamp: f"pictures/{file}" for lamp, file in view["pictures"].items()}
    (folder / "inputs").mkdir(parents=True)
    view_sets.write(folder / "pictures")
    (folder / "pictures" / "SET.json").unlink()
    (folder / "pictures" / "shown.stl").rename(folder / "inputs" / "shown.stl")
    (folder / "inputs" / "shown.yaml").write_text("name: shown\npart: shown.stl\n")
    views = folder / "part001.views.json"
    views.write_text(json.dumps(tree), encoding="utf-8")
    write_journal(runs, views)
    return folder


def write_journal(runs: Path, views: Path) -> str:
    """Judge the part of a set in a run's folder; write the journal, return the lines' hash."""
    folder, tree = views.parent, json.loads(views.read_text(encoding="utf-8"))
    journal = Journal(runs / JOURNAL_NAME, folder.name)
    journal.write(rows.RunBegan(recipe=tree["recipe"], count=1))
    for path in sorted((folder / "pictures").iterdir()):
        name = path.relative_to(folder).as_posix()
        journal.write(rows.FilesStored({name: sha256(path)}), 1)
    journal.write(rows.FilesStored({views.name: sha256(views)}), 1)
    file = load_view_set(views)
    judging = Judging(file.recipe, views, views, file.learned)
    found = judge_views(file, compiled_part(views, file), read_pictures(views, file), judging)
    journal.write(measured_row(found.measured), 1)
    journal.write(findings_row(found.findings), 1)
    ledger = replace(found.ledger, verdict=found.verdict, reasons=found.reasons)
    journal.write(verdict_row(ledger), 1)
    digest = lines_digest(found)
    journal.write(rows.PartInspected(views=views.name, lines_sha256=digest), 1)
    journal.write(rows.AtRest(state="complete"))
    journal.write(rows.RunEnded(end="complete", parts=1))
    journal.close()
    return digest
