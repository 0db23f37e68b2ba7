"""Makes judged parts: from a run as folded from its journal, or from an inspection just made.

Both ways go through rows of the journal, so that a report says the same either way.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from controller.cell.journal import rows
from controller.cell.services.records import findings_row, measured_row, verdict_row, view_row
from controller.config import split_cad
from controller.inspection import PartInspection

from ..run import PartFold, PartReport, RunRecord
from ._model import Header, JudgedPart


def judged_parts(record: RunRecord) -> tuple[JudgedPart, ...]:
    """Return the parts of a run, in order."""
    return tuple(JudgedPart(_header(record, part), part, record.folder) for part in record.parts)


def judged_part(
    inspection: PartInspection,
    header: Header,
    folder: Path,
    pictures: Mapping[str, Mapping[str, str]],
) -> JudgedPart:
    """Return a part that was inspected outside of a run.

    Parameters
    ----------
    inspection : what all views come to
    header : what was inspected
    folder : the pictures are in it
    pictures : file in the folder, by view and lamp
    """
    fold = PartFold(header.number, start=header.start, end=header.end)
    for view in inspection.views:
        fold.take(
            rows.ViewPicturesTaken(view=view.view_id, pictures=pictures.get(view.view_id, {}))
        )
        fold.take(view_row(view))
    fold.take(measured_row(inspection.measured))
    fold.take(findings_row(inspection.findings))
    fold.take(
        verdict_row(inspection.ledger).model_copy(
            update={"verdict": inspection.verdict.value, "reasons": inspection.reasons}
        )
    )
    return JudgedPart(header, fold.report(is_cut_off=False), folder)


def _serial(record: RunRecord, part: PartReport) -> str:
    if part.resumed is not None:
        return part.resumed.serial
    index = part.number - 1
    return record.serials[index] if index < len(record.serials) else ""


def _header(record: RunRecord, part: PartReport) -> Header:
    recipe, cell = record.recipe, record.cell
    cad = split_cad(Path(str(recipe.get("part", ""))))
    files = list(record.files.items())
    # in the order in which a run begins: recipe, cell, part, other parts
    at = dict(zip(("recipe", "cell"), files, strict=False))
    return Header(
        part=record.recipe_name,
        number=part.number,
        serial=_serial(record, part),
        lot=record.lot if part.resumed is None else part.resumed.lot,
        operator=record.operator,
        recipe=Path(at["recipe"][0]).name if "recipe" in at else record.recipe_name,
        recipe_sha256=at["recipe"][1] if "recipe" in at else "",
        cad=cad.name,
        cad_sha256=record.files.get(str(cad.file), ""),
        cell=record.cell_name,
        cell_sha256=at["cell"][1] if "cell" in at else "",
        calibrated=_calibrated(cell),
        calibration=record.calibration,
        software={**record.software},
        start=part.start or record.start,
        end=part.end or record.end,
        part_temperature_c=record.part_temperature_c,
        run_id=record.run_id,
        emulated_devices=record.emulated_devices,
        cell_settings=cell,
    )


def _calibrated(cell: Mapping[str, Any]) -> Mapping[str, str]:
    """Return when each camera of a cell as journaled was calibrated; empty where it is not said."""
    cameras = cell.get("cameras", {})
    if not isinstance(cameras, Mapping):
        return {}
    return {
        str(name): str(camera.get("calibrated") or "")
        for name, camera in cameras.items()
        if isinstance(camera, Mapping)
    }
