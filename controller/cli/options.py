"""Arguments and options that several commands share. Imports no room of the controller."""

from enum import StrEnum
from math import isnan
from pathlib import Path
from typing import Annotated

import typer

MAX_PART_COUNT = 100_000  # in one run; the limit of a recipe, too


class Unit(StrEnum):
    """A unit of length."""

    MM = "mm"
    CM = "cm"
    M = "m"
    INCH = "inch"


def finite(value: float | None) -> float | None:
    """Return a number from the command line.

    Raises
    ------
    BadParameter : it is nan, which would pass every limit
    """
    if value is not None and isnan(value):
        raise typer.BadParameter("nan is not a number")
    return value


RecipesArg = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="RECIPE...",
        help="recipe files (YAML), or names of recipes that come with cellctl "
        "(default: recipe.yaml in this folder, else featuretype)",
    ),
]
CountedRecipesArg = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="RECIPE[=COUNT]...",
        help="recipe files (YAML), or names of recipes that come with cellctl, each with a number "
        "of parts (default: recipe.yaml in this folder, else featuretype)",
    ),
]
RecipeCellOption = Annotated[
    Path | None,
    typer.Option("--cell", metavar="FILE", help="cell file (YAML) (default: the recipe's)"),
]
CellOption = Annotated[
    Path | None,
    typer.Option(
        "--cell",
        metavar="FILE",
        help="cell file (YAML) (default: the cell of recipe.yaml in this folder, else the "
        "emulated cell)",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="print JSON on stdout, one object per line")
]
JobsOption = Annotated[
    str | None,
    typer.Option(
        "--jobs",
        metavar="N",
        help="processes that work ahead: a number, `all` for one a core, or the address of a Dask "
        "scheduler (default: 1)",
    ),
]
DrawingsOption = Annotated[
    Path | None,
    typer.Option(
        "--drawings",
        metavar="FOLDER",
        help="write pictures (PNG) and the mesh there, one part at a time; --json names them",
    ),
]
RunsOption = Annotated[
    Path, typer.Option("--runs", metavar="FOLDER", help="folder of all runs and of the journal")
]
StoreOption = Annotated[
    str | None,
    typer.Option(
        "--store",
        metavar="URL",
        help="store of the history (default: CELLCTL_HISTORY, else history.sqlite in the folder "
        "of runs)",
    ),
]
SpeedOption = Annotated[
    float,
    typer.Option(
        "--speed",
        metavar="X",
        min=0.1,
        max=100,
        callback=finite,
        help="speed of the emulated cell in times real time",
    ),
]
WallClockOption = Annotated[
    bool,
    typer.Option(
        "--wall-clock",
        help="let the emulated cell's time run on while this computer is late, as in a real cell",
    ),
]
SeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed",
        metavar="N",
        min=0,
        max=2**32 - 1,
        help="seed of the emulated cell: same seed, same world",
    ),
]
AsBuiltOption = Annotated[
    int | None,
    typer.Option(
        "--as-built",
        metavar="SEED",
        min=0,
        max=2**32 - 1,
        help="let the emulated cell stand as real ones do, some mm and degrees off its file, by "
        "this seed (default: exactly as the file has it)",
    ),
]


class Surfaces(StrEnum):
    """How parts look in emulated pictures."""

    PLAIN = "plain"
    MACHINED = "machined"


SurfacesOption = Annotated[
    Surfaces | None,
    typer.Option(
        "--surfaces",
        help="how emulated parts look: even, or with tool marks, dust, oil and light from wall "
        "to wall (default: machined with --as-built, else plain)",
    ),
]
EmulatedPoseOption = Annotated[
    int | None,
    typer.Option(
        "--pose",
        metavar="N",
        min=0,
        help="stable pose of the first emulated part, by the index that `cellctl compile` lists "
        "(default: by the seed)",
    ),
]
EmulatedAtOption = Annotated[
    str | None,
    typer.Option(
        "--at",
        metavar="X,Y,THETA_DEG",
        help="pose of the first emulated part on the table (default: by the seed)",
    ),
]
ControlOption = Annotated[
    Path | None,
    typer.Option("--control", metavar="FILE", help="unix socket on which tests inject faults"),
]
UnitOption = Annotated[
    Unit | None,
    typer.Option("--unit", help="unit of CAD files that name none, such as STL (default: mm)"),
]
