"""recipe.yaml: what to inspect and how sharply, in human units."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from controller.cad.compiled import is_cad_file

from ._yaml import ConfigError, Section, load_yaml

DEFAULT_CELL = Path("cells/emulated.yaml")


Unit = Literal["mm", "cm", "m", "inch"]


class InspectionSection(Section):
    """How sharply the part is looked at."""

    max_incidence_deg: float = Field(70.0, ge=20, le=85)
    min_coverage: float = Field(0.90, ge=0, le=1)
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

    Raises
    ------
    ConfigError : the file is wrong, or a CAD file it names is not there
    """
    recipe = load_yaml(path, Recipe)
    base = path.parent
    recipe = recipe.model_copy(
        update={
            "part": base / recipe.part,
            "others": tuple(base / other for other in recipe.others),
            "cell": base / recipe.cell,
        }
    )
    for cad in (recipe.part, *recipe.others):
        if not cad.is_file():
            raise ConfigError(_unknown_part(path, cad))
    return recipe


def _unknown_part(recipe: Path, cad: Path) -> str:
    folder = cad.parent
    known = sorted(p.name for p in folder.glob("*") if is_cad_file(p))
    have = f"the folder has {', '.join(known)}" if known else f"there is nothing in {folder}"
    return f"{recipe}: unknown part: no file {cad}; {have}"
