"""Data of one part from the journal, beside the store: its pictures and compared shares."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.cell.journal import JOURNAL_NAME
from controller.history import folded
from controller.results.run import PartReport, RunRecord

PER_MILLE = 1000


@dataclass(frozen=True, slots=True)
class PartPicture:
    """A picture of a part: its number among them, and its subject."""

    number: int
    view: str
    lamp: str
    file: str


@dataclass(frozen=True, slots=True)
class PartPictures:
    """Data of a part from the journal.

    Attributes
    ----------
    pictures : pictures of the table, then of the views
    coverage : compared share of each face, as JSON; None where the part was not judged
    recipe, files : recipe and files of the part, and what the run read, by path: for its mesh
    is_whole : the run has ended, and no more comes
    """

    pictures: tuple[PartPicture, ...]
    coverage: dict[str, Any] | None
    recipe: Mapping[str, Any]
    files: Mapping[str, str]
    is_whole: bool


def shown(runs_dir: Path, run: str, number: int) -> PartPictures | None:
    """Return the journal's data of a part; None where there is no such part.

    Parameters
    ----------
    runs_dir : folder of all runs
    run, number : run and number of the part

    Raises
    ------
    JournalError : the journal cannot be read
    ResultsError : a row is not what this version of cellctl writes
    """
    record = folded(runs_dir / JOURNAL_NAME, run, [number])
    part = next((one for one in record.parts if one.number == number), None)
    if part is None:
        return None
    found = [("", lamp, file) for lamp, file in part.table_pictures.items()]
    found += [
        (view.view, lamp, file) for view in part.views for lamp, file in view.pictures.items()
    ]
    pictures = tuple(PartPicture(i, *one) for i, one in enumerate(found))
    return PartPictures(
        pictures,
        _coverage(record, part),
        record.recipe_of(part).recipe,
        record.files,
        record.outcome.end != "cut_off",
    )


def _coverage(record: RunRecord, part: PartReport) -> dict[str, Any] | None:
    verdict = part.verdict
    if verdict is None:
        return None
    return {
        "run": record.run_id,
        "part": part.number,
        "recipe": str(record.recipe_of(part).recipe.get("name", "")),
        "views": sum(bool(view.evaluated) for view in part.views),
        "faces": [
            [face.face, round(PER_MILLE * face.compared_fraction), PER_MILLE]
            for face in verdict.faces
        ],
        "why": {face.face: face.reason for face in verdict.faces if face.reason},
    }
