"""recipe.yaml: what to inspect and how sharply, in human units."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from ._yaml import ConfigError, Section, load_yaml

DEFAULT_CELL = Path("cells/emulated.yaml")


class InspectionSection(Section):
    """How sharply the part is looked at."""

    max_incidence_deg: float = Field(70.0, ge=20, le=85)
    min_coverage: float = Field(0.90, ge=0, le=1)
    smallest_defect_mm: float = Field(3.0, ge=0.5, le=50)


class GripSection(Section):
    """How the part may be held."""

    force_n: float = Field(60.0, ge=20, le=200)
    width_tolerance_mm: float = Field(2.0, ge=0.2, le=10)


class Recipe(Section):
    """One product.

    Attributes
    ----------
    name : how people call it
    part : CAD file, relative to the recipe
    others : CAD files of other parts that may turn up on the table
    density_g_cm3 : of the material, for the load on the grips
    cell : cell file, relative to the recipe; the emulated cell if nothing is said
    """

    name: str
    part: Path
    others: tuple[Path, ...] = ()
    density_g_cm3: float = Field(2.7, gt=0, le=25)
    cell: Path = DEFAULT_CELL
    inspection: InspectionSection = InspectionSection()
    grip: GripSection = GripSection()
    count: Annotated[int, Field(ge=1, le=100_000)] = 1


def load_recipe(path: Path) -> Recipe:
    """Read a recipe; its file names come back relative to the working directory.

    Raises
    ------
    ConfigError : the file, or a file it names, is wrong
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
    known = sorted(p.name for p in folder.glob("*") if p.suffix.lower() in {".stl", ".obj", ".ply"})
    have = f"the folder has {', '.join(known)}" if known else f"there is nothing in {folder}"
    return f"{recipe}: unknown part: no file {cad}; {have}"
