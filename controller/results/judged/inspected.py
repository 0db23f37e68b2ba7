"""Makes a judged part from an inspection just made.

It goes by rows of the journal, so that a report has the same content as one of a run.
"""

from collections.abc import Mapping
from pathlib import Path

from controller.cell.journal import rows
from controller.cell.services.records import findings_row, measured_row, verdict_row, view_row
from controller.inspection import PartInspection

from ..run import PartFold, RunPictures
from ._model import Header, JudgedPart


def judged_part(
    inspection: PartInspection,
    header: Header,
    folder: Path,
    pictures: Mapping[str, Mapping[str, str]],
) -> JudgedPart:
    """Return a part that was inspected outside of a run.

    Parameters
    ----------
    inspection : results of all views together
    header : header of the report
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
    return JudgedPart(header, fold.report(is_cut_off=False), RunPictures(folder))
