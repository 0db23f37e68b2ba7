"""Makes judged parts from a run as folded from its journal."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from controller.config import split_cad

from ..run import PartReport, RunPictures, RunRecord
from ._model import Header, JudgedPart


def judged_parts(record: RunRecord) -> tuple[JudgedPart, ...]:
    """Return the parts of a run, in order."""
    pictures = RunPictures(record.folder, record.copies)
    return tuple(JudgedPart(_header(record, part), part, pictures) for part in record.parts)


def counted_parts(record: RunRecord) -> tuple[JudgedPart, ...]:
    """Return the parts whose record is in this run, in order: no part is in two runs' files."""
    return tuple(judged for judged in judged_parts(record) if judged.part.is_counted)


def _header(record: RunRecord, part: PartReport) -> Header:
    ordered, cell = record.recipe_of(part), record.cell
    serial, lot = record.label_of(part)
    name = str(ordered.recipe.get("name", "unknown"))
    cad = split_cad(Path(str(ordered.recipe.get("part", ""))))
    # in the order in which a run begins: first recipe, cell, parts, calibrations, other recipes
    cell_file, *_ = (*list(record.files.items())[1:2], ("", ""))
    return Header(
        part=name,
        number=part.number,
        serial=serial,
        lot=lot,
        operator=record.operator,
        recipe=Path(ordered.file).name or name,
        recipe_sha256=record.files.get(ordered.file, ""),
        cad=cad.name,
        cad_sha256=record.files.get(str(cad.file), ""),
        cell=record.cell_name,
        cell_sha256=cell_file[1],
        calibrated=_calibrated(cell),
        calibration=record.calibration,
        software={**record.software},
        start=part.start or record.start,
        end=part.end or record.end,
        part_temperature_c=record.part_temperature_c,
        run_id=record.run_id,
        emulated_devices=record.emulated_devices,
        cell_settings=cell,
        papers=record.papers_of(part),
    )


def _calibrated(cell: Mapping[str, Any]) -> Mapping[str, str]:
    """Return each camera's date of calibration, by the cell in the journal; empty if not stated."""
    cameras = cell.get("cameras", {})
    if not isinstance(cameras, Mapping):
        return {}
    return {
        str(name): str(camera.get("calibrated") or "")
        for name, camera in cameras.items()
        if isinstance(camera, Mapping)
    }
