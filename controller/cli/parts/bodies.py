"""`cellctl compile --all`: the bodies of STEP files, each shape once, and their table."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

from controller.cad import CadError
from controller.cad.compiled import CompiledPart, part_name
from controller.cad.reading.step.bodies import Bodies
from controller.cad.reading.step.choosing import missing_text, require_any, row_text, size_text
from controller.cad.reading.step.files import list_bodies
from controller.config import STEP_FORMATS, ConfigError, split_cad
from controller.config.cad_files import body_path

from ..inputs.part_files import PartFile
from ..terminal.output import emit, print_line, warn

WIDEST: Final = 40  # largest width of the column of names
WIDEST_ROW: Final = 80


@dataclass(frozen=True, slots=True)
class BodyFile:
    """A part to compile.

    Attributes
    ----------
    file : compile options of the file
    body : JSON entry of one body of several; empty otherwise
    row : number of placements and size, in words; empty otherwise
    """

    file: PartFile
    body: dict[str, Any]
    row: str = ""


@dataclass(frozen=True)
class BodyFiles:
    """All parts to compile, and whether a file could not be listed, or only in part."""

    files: tuple[BodyFile, ...]
    is_whole: bool = True

    @classmethod
    def of(cls, files: Sequence[PartFile]) -> "BodyFiles":
        """Return files unchanged, a part each."""
        return cls(tuple(BodyFile(file, {}) for file in files))

    def print_compiled(self, one: BodyFile, part: CompiledPart, seconds: float) -> None:
        """Print the row of a body that was compiled.

        Parameters
        ----------
        one, part : the body, and what follows from it
        seconds : time of compiling
        """
        solid, count = part.solid, len(part.poses)
        poses = f"{count} stable pose{'' if count == 1 else 's'}"
        what = f"{solid.volume_mm3 / 1000:.1f} cm3, {len(solid.faces)} surfaces, {poses}"
        row = one.row or size_text(solid.mesh.extents)
        self._print_row(one, row, f"{what}, {seconds:.1f} s")
        for caution in part.cautions:
            warn(f"{solid.name}: {caution}")

    def report_refused(self, one: BodyFile, error: CadError, *, as_json: bool) -> None:
        """Print the row of a refused body; the reason goes to stderr, and into JSON.

        Parameters
        ----------
        one : the body
        error : reason of the refusal
        as_json : print an object instead of the row
        """
        name = part_name(one.file.path)
        if as_json:
            kind = type(error).__name__
            emit({"part": name, "refused": str(error), "error": kind, **one.body})
        else:
            self._print_row(one, one.row, "refused")

    def _print_row(self, one: BodyFile, row: str, result: str) -> None:
        width, row_width = self._widths
        print_line(f"{part_name(one.file.path):<{width}}  {row:<{row_width}}  {result}")

    @cached_property
    def _widths(self) -> tuple[int, int]:
        """The widths of the columns of names and sizes; splitting a name looks for its file."""
        names = (part_name(each.file.path) for each in self.files)
        rows = (len(each.row) for each in self.files)
        return min(max(map(len, names)), WIDEST), min(max(rows), WIDEST_ROW)


def every_body(files: Sequence[PartFile]) -> BodyFiles:
    """Return each distinct body of each file; report those that cannot be listed.

    Parameters
    ----------
    files : CAD files of any kind; those that are no STEP hold one body

    Raises
    ------
    ConfigError : a body is named already, or the file comes from a recipe
    """
    found: list[BodyFile] = []
    is_whole = True
    for file in files:
        source = split_cad(file.path)
        if file.recipe_path is not None:
            raise ConfigError("--all requires a CAD file")
        if source.body is not None:
            raise ConfigError(f"{file.path}: --all compiles every body; leave out #{source.body}")
        if source.ending not in STEP_FORMATS:
            found.append(BodyFile(file, {}))
            continue
        try:
            bodies = list_bodies(file.path)
            require_any(file.path, bodies)
        except CadError as error:
            warn(f"cellctl: {error}")
            is_whole = False
            continue
        if bodies.missing:
            warn(f"cellctl: {file.path}: {missing_text(file.path, bodies)}")
            is_whole = False
        for name in bodies.open_names:
            warn(f"{file.path}: {name} is left out: its surfaces enclose no solid")
        found += _bodies(file, bodies)
    return BodyFiles(tuple(found), is_whole)


def _bodies(file: PartFile, bodies: Bodies) -> Iterator[BodyFile]:
    """Yield the bodies of a STEP file."""
    if bodies.count == 1 and not bodies.missing:
        yield BodyFile(file, {})
        return
    for body in bodies.distinct:
        about = {
            "file": str(file.path),
            "body": body.name,
            "also": list(body.also),
            "occurrences": [
                {"in": list(place.within), "T_file_body": place.T_file_body.tolist()}
                for place in body.occurrences
            ],
        }
        path = body_path(file.path, body.name)
        yield BodyFile(replace(file, path=path), about, row_text(body))
