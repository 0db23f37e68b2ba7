"""recipe.yaml: what to inspect and how sharply, in human units."""

import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from controller.cad import Face
from controller.cad.compiled import is_cad_file

from ._yaml import Section, line_in, load_with_lines
from .errors import ConfigError
from .files import reason_of

DEFAULT_CELL = Path("cells/emulated.yaml")
_RUN = re.compile(r"f(\d{1,6}) to f(\d{1,6})")
MOST_NAMED = 12  # files of a folder that a message lists

Unit = Literal["mm", "cm", "m", "inch"]


FaceName = Annotated[str, Field(min_length=1, max_length=80)]
Reason = Annotated[str, Field(min_length=4, max_length=200)]


class InspectionSection(Section):
    """How sharply the part is looked at.

    Attributes
    ----------
    min_coverage : share of the surface that must have been compared for a pass, above 0
    not_inspected : why a face need not be inspected, by its name; see `faces_left_out`
    """

    max_incidence_deg: float = Field(70.0, ge=20, le=85)
    min_coverage: float = Field(0.50, gt=0, le=1)
    not_inspected: dict[FaceName, Reason] = Field(default_factory=dict)
    smallest_defect_mm: float = Field(3.0, ge=0.5, le=50)
    least_gain: float = Field(0.0, ge=0, le=0.1)  # of the surface, that a view must add


class GripSection(Section):
    """How the part may be held."""

    force_n: float = Field(60.0, ge=20, le=200)
    width_tolerance_mm: float = Field(2.0, ge=0.2, le=10)


def _fit_for_a_folder(name: str) -> str:
    """Raise ValueError where a name cannot be part of a run's folder."""
    if not name.strip() or len(name) > 80 or any(c in "/\\" or not c.isprintable() for c in name):
        raise ValueError("1 to 80 characters without slashes: it becomes part of a folder's name")
    return name


class Recipe(Section):
    """One product.

    Attributes
    ----------
    name : how people call it
    part : CAD file, relative to the recipe
    others : CAD files of other parts that may turn up on the table
    unit : of the lengths in those CAD files that name none, as STL; it contradicts no part that
        does
    density_g_cm3 : of the material, for the load on the grips; what the CAD file says, or
        aluminium's, if nothing is said
    cell : cell file, relative to the recipe; the emulated cell if nothing is said
    """

    name: Annotated[str, AfterValidator(_fit_for_a_folder)]
    part: Path
    others: tuple[Path, ...] = ()
    unit: Unit | None = None
    density_g_cm3: float | None = Field(None, gt=0, le=25)
    cell: Path = DEFAULT_CELL
    inspection: InspectionSection = InspectionSection()
    grip: GripSection = GripSection()
    count: Annotated[int, Field(ge=1, le=100_000)] = 1


def load_recipe(path: Path) -> Recipe:
    """Read a recipe; its file names come back relative to the working directory.

    A recipe and what it names travel together: part, others and cell lie in its folder or below,
    also behind symbolic links, so that a recipe that came with a mail reads nothing else. A cell
    somewhere else is named by the person at the machine, with ``--cell``.

    Raises
    ------
    ConfigError : the file is wrong, a file it names lies outside its folder, or a CAD file is not
        there
    """
    loaded = load_with_lines(path, Recipe)
    recipe, line_of = loaded.value, loaded.line_of

    def inside(name: Path, *location: int | str) -> Path:
        line = line_of(location)
        where = f"{path}:{line}" if line is not None else f"{path}"
        return _inside(path, name, where, location)

    part = inside(recipe.part, "part")
    others = tuple(inside(other, "others", i) for i, other in enumerate(recipe.others))
    cell = inside(recipe.cell, "cell")
    named = [(part, line_of(("part",)))]
    named += [(other, line_of(("others", i))) for i, other in enumerate(others)]
    for cad, line in named:
        if not _is_file(cad):
            raise ConfigError(_unknown_part(path, cad, line))
    return recipe.model_copy(update={"part": part, "others": others, "cell": cell})


def _inside(recipe: Path, name: Path, where: str, location: tuple[int | str, ...]) -> Path:
    """Return a file a recipe names, ConfigError where it is none of the recipe's folder."""
    file, key = recipe.parent / name, location[0]
    try:
        is_inside = file.resolve().is_relative_to(recipe.parent.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # no name for a file, links in a circle
        raise ConfigError(f"{where}: `{key}`: {reason_of(error)} ({str(name)!r:.80})") from error
    if not is_inside:
        mend = "name the cell with --cell" if key == "cell" else "copy the file there"
        raise ConfigError(f"{where}: `{key}`: {name} lies outside the recipe's folder; {mend}")
    return file


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False


def faces_left_out(path: Path, recipe: Recipe, faces: Sequence[Face]) -> dict[int, str]:
    """Return which faces of its part a recipe leaves out, by face id, each with the reason.

    A name is a face's number (``F12``), a run of them (``F12 to F15``), a label (``F12 bore 8.0
    mm``), or what a label says without the number, which means all such faces (``bore 8.0 mm``,
    ``torus``). Planes are named by number.

    Parameters
    ----------
    path : of the recipe, for the message

    Raises
    ------
    ConfigError : a name that no face has, with the nearest ones
    """
    names: dict[str, list[int]] = {}
    for face in faces:
        number, _, kind = face.label.partition(" ")
        for name in (number, face.label) if kind == "plane" else (number, face.label, kind):
            names.setdefault(name.lower(), []).append(face.id)
    left_out: dict[int, str] = {}
    problems = []
    for name, reason in recipe.inspection.not_inspected.items():
        wanted = " ".join(name.lower().split())
        if run := _RUN.fullmatch(wanted):
            ids = range(int(run[1]), int(run[2]) + 1)
            if len(ids) > 1 and ids[-1] < len(faces):
                left_out |= dict.fromkeys(ids, reason)
                continue
        if wanted not in names:
            problems.append(_unknown_face(path, name, wanted, names))
        left_out |= dict.fromkeys(names.get(wanted, ()), reason)
    if problems:
        raise ConfigError("\n".join(problems))
    return left_out


def _unknown_face(path: Path, name: str, wanted: str, names: dict[str, list[int]]) -> str:
    line = line_in(path, ("inspection", "not_inspected", name))
    where = f"{path}:{line}" if line is not None else f"{path}"
    if wanted == "plane":
        hint = "planes are named by number, as in `F3` or `F3 to F9`"
    else:
        near = difflib.get_close_matches(wanted, names, n=3, cutoff=0.4)
        numbers = [n for n in names if n.startswith("f") and n[1:].isdigit()]
        known = f"the part has F0 to F{len(numbers) - 1}; `cellctl compile` lists them"
        hint = f"nearest: {', '.join(near)}; {known}" if near else known
    return f"{where}: `inspection.not_inspected`: no face {name!r} on the part; {hint}"


def _unknown_part(recipe: Path, cad: Path, line: int | None) -> str:
    folder = cad.parent
    try:
        known = sorted(p.name for p in folder.glob("*") if is_cad_file(p))
    except OSError:
        known = []
    shown = ", ".join(known[:MOST_NAMED]) + (" ..." if len(known) > MOST_NAMED else "")
    have = f"the folder has {shown}" if known else f"there is nothing in {folder}"
    return f"{recipe}:{line}: unknown part: no file {cad}; {have}"
