"""One part of the archive judged anew, in any process that sees its files."""

import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from controller.cad import CadError
from controller.cell.services.records import measured_row
from controller.config import ConfigError, Recipe
from controller.config.files import file_sha256
from controller.config.view_set import ViewSetFile, load_view_set
from controller.results.run import Copy, RunPictures
from controller.stored import compiled_part, judge_views, judging_by, lines_digest, read_pictures


@dataclass(frozen=True, slots=True)
class ArchivedPart:
    """A part to judge anew.

    Attributes
    ----------
    part_id : its key in the store
    folder : folder of its run
    views : file of its views, in there; empty where the journal has none
    hashes : SHA-256 of its files in the journal, by name in the folder; empty for an old run
    recipe, recipe_path : recipe to judge by, and its file, for messages
    copies : copies of pictures in a store of objects, by name; read where a picture is not here
    """

    part_id: int
    folder: Path
    views: str
    hashes: Mapping[str, str]
    recipe: Recipe
    recipe_path: Path
    copies: Mapping[str, Copy] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Rejudged:
    """The result of one part.

    Attributes
    ----------
    problem : why it could not be judged, in a sentence; empty if it was
    verdict, reasons : as of any inspection
    characteristics : as the journal has them
    lines_sha256 : hash of the result lines, every number to its last bit
    seconds : CPU time of the process [s]
    """

    problem: str = ""
    verdict: str = ""
    reasons: tuple[str, ...] = ()
    characteristics: tuple[dict[str, Any], ...] = ()
    lines_sha256: str = ""
    seconds: float = 0.0


def rejudge(part: ArchivedPart) -> Rejudged:
    """Judge a part by the pictures of its run, if the journal knows them; return the result.

    Parameters
    ----------
    part : the part
    """
    began = time.process_time()
    try:
        if not part.views:
            raise ConfigError("the journal names no file of its views")
        path = part.folder / part.views
        file = load_view_set(path)
        judging = judging_by(path, file, part.recipe, part.recipe_path)
        with TemporaryDirectory(prefix="cellctl-pictures-") as scratch:
            here = _with_copies(part, file, Path(scratch))
            pictures = read_pictures(path, here)
            _require_unchanged(part, here, proven=Path(scratch))
        found = judge_views(file, compiled_part(path, file), pictures, judging)
    except (CadError, ConfigError) as error:
        return Rejudged(problem=" ".join(str(error).split()))
    measured = measured_row(found.measured).characteristics
    return Rejudged(
        "",
        found.verdict.value,
        tuple(found.reasons),
        tuple(one.model_dump(mode="json", exclude={"looks", "anchors_mm"}) for one in measured),
        lines_digest(found),
        time.process_time() - began,
    )


def _with_copies(part: ArchivedPart, file: ViewSetFile, folder: Path) -> ViewSetFile:
    """Return a set of views whose missing pictures are read from their copies.

    Parameters
    ----------
    part : the part
    file : its views
    folder : for these pictures; nothing comes back into the run's folder

    Raises
    ------
    ConfigError : a copy cannot be read, or is of another picture
    """
    reader = RunPictures(part.folder, part.copies)

    def present(path: Path) -> Path:
        name = os.path.relpath(path, part.folder)
        if path.is_file() or name not in part.copies:
            return path
        if part.hashes.get(name) != part.copies[name].sha256:
            raise ConfigError(f"{path}: its copy is not of the picture that the journal has")
        data = reader.read(name)  # which checks the hash
        if isinstance(data, str):
            raise ConfigError(data)
        fetched = folder / name
        fetched.parent.mkdir(parents=True, exist_ok=True)
        fetched.write_bytes(data)
        return fetched

    views = [
        view.model_copy(update={"pictures": {k: present(v) for k, v in view.pictures.items()}})
        for view in file.views
    ]
    return file.model_copy(update={"views": type(file.views)(views)})


def _require_unchanged(part: ArchivedPart, file: ViewSetFile, *, proven: Path) -> None:
    """Require that the files are those that the journal has the hashes of; `proven` has such.

    Raises
    ------
    ConfigError : one was changed, or is none of the run's
    """
    if not part.hashes:
        return
    for path in _files(part, file):
        if path.is_relative_to(proven):
            continue
        name = os.path.relpath(path, part.folder)
        known = part.hashes.get(name)
        if known is None:
            raise ConfigError(f"{path}: is not in the journal of its run")
        if file_sha256(path) != known:
            raise ConfigError(f"{path}: was changed since the run; its hash is not the journal's")


def _files(part: ArchivedPart, file: ViewSetFile) -> Iterator[Path]:
    yield part.folder / part.views
    for view in file.views:
        yield from view.pictures.values()
