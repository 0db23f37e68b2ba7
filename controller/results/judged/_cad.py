"""The CAD model of a run's part, for drawings: only the file that the run had."""

import hashlib
from pathlib import Path

from controller.cad import CadError, Solid
from controller.cad.compiled import load_part, options_among
from controller.config import split_cad
from controller.config.cad_files import body_path

from ..run import RunRecord


def solid_of_run(record: RunRecord) -> Solid | str:
    """Return the CAD model of a run's part, or why there is none to draw."""
    name = Path(str(record.recipe.get("part", "")))
    source = split_cad(name)
    path, sha256_then = source.file, record.files.get(str(source.file))
    if sha256_then is None:
        return "the journal does not name the CAD file"
    if not path.is_absolute() and not path.is_file():
        # the run began where its folder of runs is
        path = record.folder.absolute().parent.parent / path
    try:
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return f"the CAD file {path.name} is no longer where the run found it"
    if sha256 != sha256_then:
        return f"the CAD file {path.name} was changed since the run"
    unit = record.recipe.get("unit")
    try:
        part = path if source.body is None else body_path(path, source.body)
        return load_part(part, options_among(part, str(unit) if unit else None)).solid
    except (CadError, OSError) as error:
        return f"the CAD file {path.name} cannot be read: {error}"
