"""Pictures of one part, and what the store lacks of it: compared shares, what its mesh is of."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.history import folded
from controller.results.run import Copy, ObjectStore, PartReport, RunPictures, RunRecord

PER_MILLE = 1000


@dataclass(frozen=True, slots=True)
class PartPicture:
    """A picture of a part: its number among them, and its subject."""

    number: int
    view: str
    lamp: str
    file: str


@dataclass(frozen=True, slots=True)
class PartShown:
    """Data of a part from the journal.

    Attributes
    ----------
    coverage : compared share of each face, as JSON; None where the part was not judged
    recipe, files : recipe and files of the part, and what the run read, by path: for its mesh
    is_whole : the run has ended, and no more comes
    """

    coverage: dict[str, Any] | None
    recipe: Mapping[str, Any]
    files: Mapping[str, str]
    is_whole: bool


def pictures_of(part: Mapping[str, Any]) -> tuple[PartPicture, ...]:
    """Return the pictures of a part, of the table, then of the views.

    Parameters
    ----------
    part : as the store has it
    """
    return tuple(
        PartPicture(i, str(one["view"]), str(one["lamp"]), str(one["file"]))
        for i, one in enumerate(part["pictures"])
    )


def read_picture(
    part: Mapping[str, Any], number: int, folder: Path | None, stores: dict[str, ObjectStore | str]
) -> bytes | str:
    """Return a picture of a part, or the reason why there is none.

    Parameters
    ----------
    part : as the store has it
    number : number of the picture
    folder : folder of the run; None if it is not on this machine
    stores : stores of objects, as `RunPictures` takes them
    """
    one = part["pictures"][number]
    file, to = str(one["file"]), str(part["copied_to"])
    copies = {file: Copy(to, str(one["sha256"]))} if to else {}
    reader = RunPictures(folder or Path(), copies, is_here=folder is not None, stores=stores)
    return reader.read(file)


def shown(journal: Path, run: str, number: int) -> PartShown | None:
    """Return the journal's data of a part; None where there is no such part.

    Parameters
    ----------
    journal : the journal
    run, number : run and number of the part

    Raises
    ------
    JournalError : the journal cannot be read
    ResultsError : a row is not what this version of cellctl writes
    """
    record = folded(journal, run, [number])
    part = next((one for one in record.parts if one.number == number), None)
    if part is None:
        return None
    return PartShown(
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
