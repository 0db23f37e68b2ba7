"""A cell from its files and journal: devices, calibrations, steps, drift. Asks no device."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from controller.bring_up import CommissionOrder
from controller.bring_up.procedure import CommissioningFolder
from controller.cell.journal import JOURNAL_NAME, JournalError, read_rows_counted, rows
from controller.cell.journal.usage import usage_of, views_off_mm
from controller.config import (
    SHIPPED,
    Cell,
    ConfigError,
    is_cell_file,
    load_cell,
    load_recipe,
    yaml_tree,
)
from controller.config.calibrations import MAX_OFF_MM, Usage, read_calibrations, standing_of

MAX_CELL_COUNT: Final = 100
PATTERNS: Final = ("*.yaml", "cells/*.yaml", "commissioning/*/cell.yaml")
EVIDENCE_PAGE: Final = "commissioning.html"
EVIDENCE_KINDS: Final = {".html": "text/html", ".json": "application/json", ".png": "image/png"}
MAX_EVIDENCE_COUNT: Final = 2_000
DRIFT_MAX_COUNT: Final = 300  # parts in the chart, the last ones
HISTORY_EVERY_S: Final = 60.0  # shortest time between reads of the whole journal


@dataclass(frozen=True, slots=True)
class CellFile:
    """A cell file.

    Attributes
    ----------
    key : name of it at the page
    path : the file
    """

    key: str
    path: Path


@dataclass(frozen=True, slots=True)
class Past:
    """Record of a cell in the runs of a journal.

    Attributes
    ----------
    usage : use of calibrations, by the hash of their files
    off_mm : part by part, oldest first: how far arm and station camera disagreed between views
    connected : identities that the devices reported when a run last connected
    connected_at : time of that, UTC; empty if never
    connected_run : run of that
    emulated : devices that were emulated in it
    problem : reason why the journal cannot be read; empty where it can, or is not there
    """

    usage: Mapping[str, Usage]
    off_mm: tuple[float, ...] = ()
    connected: Mapping[str, str] | None = None
    connected_at: str = ""
    connected_run: str = ""
    emulated: tuple[str, ...] = ()
    problem: str = ""


class CellFiles:
    """The cell files of a project.

    Parameters
    ----------
    project : folder of recipes and cell files
    shipped : folder of those that come with cellctl
    """

    def __init__(self, project: Path, shipped: Path = SHIPPED) -> None:
        self._project = project
        self._shipped = shipped

    def all(self) -> Sequence[CellFile]:
        """Return all cell files: the one of the project's recipe first, shipped ones last."""
        own = [
            CellFile(f"project/{path.relative_to(self._project)}", path)
            for pattern in PATTERNS
            for path in _cells(self._project, pattern)
        ]
        usual = self._usual()
        own.sort(key=lambda one: (usual is None or one.path.resolve() != usual, one.key))
        come_along = [
            CellFile(f"shipped/{path.name}", path) for path in _cells(self._shipped, "cells/*.yaml")
        ]
        seen = {one.path.resolve() for one in own}
        return [*own, *(one for one in come_along if one.path.resolve() not in seen)]

    def find(self, key: str) -> CellFile | None:
        """Return a cell file by its key, as `named` does."""
        return named(self.all(), key)

    def commissioned(self, file: CellFile, cell: Cell) -> CommissioningFolder:
        """Return the folder of a cell's commissioning, which need not exist.

        Parameters
        ----------
        file : file of the cell
        cell : its name leads to the folder, unless the file stands in one
        """
        beside = file.path.parent
        if (beside / "steps").is_dir():
            return CommissioningFolder(beside)
        return CommissioningFolder(self._project / "commissioning" / cell.name)

    def _usual(self) -> Path | None:
        path = self._project / "recipe.yaml"
        try:
            return load_recipe(path).cell.resolve() if path.is_file() else None
        except ConfigError:
            return None


def named(files: Sequence[CellFile], key: str) -> CellFile | None:
    """Return a cell file by its key, the first for an empty one; None if there is none."""
    return next((one for one in files if not key or one.key == key), None)


class History:
    """Past runs from the journal, which is read whole once a minute at most.

    Parameters
    ----------
    runs_dir : folder of all runs
    clock : seconds that only go up
    """

    def __init__(self, runs_dir: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._path = runs_dir / JOURNAL_NAME
        self._clock = clock
        self._past: Past | None = None
        self._read_s = 0.0

    def past(self) -> Past:
        """Return the record of the runs."""
        if self._past is None or self._clock() - self._read_s >= HISTORY_EVERY_S:
            self._past = read_past(self._path)
            self._read_s = self._clock()
        return self._past


def read_past(journal: Path) -> Past:
    """Return the record of the cell in the runs of a journal."""
    if not journal.exists():
        return Past({})
    began, posed, connected = rows.RunBegan.row_name, rows.ViewsPosed.row_name, "connected"
    try:
        found = list(read_rows_counted(journal, (began, posed, connected)))
    except JournalError as error:
        return Past({}, problem=str(error))
    emulated: dict[str, tuple[str, ...]] = {}
    off_mm: list[float] = []
    last = None
    for row in found:
        if row.name == began:
            emulated[row.run] = tuple(row.body.get("emulated_devices", ()))
        elif row.name == posed:
            off = views_off_mm(rows.ViewsPosed.model_validate(row.body))
            if off is not None:
                off_mm.append(off)
        else:
            last = row
    past = Past(usage_of(found), tuple(off_mm[-DRIFT_MAX_COUNT:]))
    if last is None:
        return past
    return Past(
        past.usage,
        past.off_mm,
        {str(name): str(text) for name, text in last.body.items()},
        last.t_utc,
        last.run,
        emulated.get(last.run, ()),
    )


def cell_facts(files: CellFiles, file: CellFile, past: Past, now: datetime) -> dict[str, Any]:
    """Return the data that the screen shows of a cell.

    Parameters
    ----------
    files, file : files and file of the cell
    past : record of it in past runs
    now : with its offset from UTC
    """
    found: dict[str, Any] = {"key": file.key, "file": file.path.name, "problem": ""}
    try:
        cell = load_cell(file.path)
    except ConfigError as error:
        return found | {"problem": str(error).replace(f"{file.path.parent}/", "")}
    folder = files.commissioned(file, cell)
    return found | {
        "name": cell.name,
        "devices": _devices(cell, past),
        "connected": {"at": past.connected_at, "run": past.connected_run},
        "journal": past.problem,
        **_calibrations(file, cell, past, now),
        "steps": _steps(file, folder, now),
        "evidence": evidence(folder),
        "drift": {"off_mm": past.off_mm, "max_mm": MAX_OFF_MM},
    }


def evidence(folder: CommissioningFolder) -> list[str]:
    """Return the files that a commissioning has left, by their names within its folder."""
    found = [EVIDENCE_PAGE] if (folder.path / EVIDENCE_PAGE).is_file() else []
    below = folder.path / "evidence"
    if below.is_dir():
        names = sorted(below.glob("*/*"), reverse=True)[:MAX_EVIDENCE_COUNT]
        found += [
            str(path.relative_to(folder.path))
            for path in names
            if path.suffix in EVIDENCE_KINDS and path.is_file()
        ]
    return found


def _cells(folder: Path, pattern: str) -> list[Path]:
    found = []
    for path in sorted(folder.glob(pattern))[:MAX_CELL_COUNT]:
        try:
            if not path.name.startswith(".") and is_cell_file(yaml_tree(path)):
                found.append(path)
        except ConfigError:
            continue  # a broken file may be anything
    return found


def _devices(cell: Cell, past: Past) -> list[dict[str, Any]]:
    said = past.connected or {}
    return [
        {
            "name": name,
            "driver": getattr(cell.devices, name).driver,
            "address": getattr(cell.devices, name).address,
            "is_emulated": name in cell.emulated_devices,
            "said": said.get(name, ""),
            "was_emulated": name in past.emulated,
        }
        for name in type(cell.devices).model_fields
    ]


def _calibrations(file: CellFile, cell: Cell, past: Past, now: datetime) -> dict[str, Any]:
    references = cell.calibration
    found = read_calibrations(file.path, references)
    standing = standing_of(references, found, now, past.usage)
    each = []
    for one in standing.each:
        calibration = found[one.name]
        used = past.usage.get(references[one.name].sha256, Usage())
        residual = calibration.residual
        each.append(
            {
                "name": one.name,
                "measured": one.measured.isoformat(),
                "age_days": (now - one.measured).total_seconds() / 86_400,
                "valid_days": calibration.valid_days,
                "by": calibration.by,
                "run_count": used.run_count,
                "valid_runs": calibration.valid_runs,
                "residual": None if residual is None else residual.model_dump(),
                "why_stale": one.why_stale,
            }
        )
    return {"calibrations": each, "why_not_verified": standing.why_not_verified}


def _steps(file: CellFile, folder: CommissioningFolder, now: datetime) -> list[dict[str, str]]:
    try:
        standings = CommissionOrder(file.path, folder, "").standings(now)
    except ConfigError as error:
        return [{"step": "", "status": "failed", "reason": str(error)}]
    return [
        {"step": one.step, "status": one.status.value, "reason": one.reason} for one in standings
    ]
