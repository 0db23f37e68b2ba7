"""The CAD model of a run's part, for drawings: only the file that the run had."""

import hashlib
from pathlib import Path

from controller.cad import CadError, Solid
from controller.cad.compiled import load_part, options_among

from ..run import RunRecord


def solid_of_run(record: RunRecord) -> Solid | str:
    """Return the CAD model of a run's part, or why there is none to draw."""
    name = str(record.recipe.get("part", ""))
    if not name or name not in record.files:
        return "the journal does not name the CAD file"
    path = Path(name)
    if not path.is_absolute() and not path.is_file():
        # the run began where its folder of runs is
        path = record.folder.absolute().parent.parent / name
    try:
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return f"the CAD file {path.name} is no longer where the run found it"
    if sha256 != record.files[name]:
        return f"the CAD file {path.name} was changed since the run"
    unit = record.recipe.get("unit")
    try:
        return load_part(path, options_among(path, str(unit) if unit else None)).solid
    except (CadError, OSError) as error:
        return f"the CAD file {path.name} cannot be read: {error}"
