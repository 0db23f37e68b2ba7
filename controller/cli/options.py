"""Arguments and options that several commands share. Imports no room of the controller."""

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from enum import StrEnum
from functools import wraps
from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer

MAX_PART_COUNT = 100_000  # parts in one run; also the limit of a recipe

# Titles of sections of the help.
EMULATED = "Emulated cell"
REPORTED = "Parts and their report"


def from_fields(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with an option or argument for each field of the dataclasses it takes.

    A parameter whose type is a dataclass stands for the fields of that dataclass, and a field of
    such a type for its own: an option is declared once, as the field that is read.
    """

    @wraps(command)
    def called(**given: Any) -> None:  # noqa: ANN401  (of the types of the fields)
        _filled(command, given)

    flat = inspect.Signature(list(_parameters(command)))
    called.__signature__ = flat  # type: ignore[attr-defined]  # what typer reads
    return called


def _parameters(made: Callable[..., Any]) -> Iterator[inspect.Parameter]:
    for one in inspect.signature(made).parameters.values():
        if _has_fields(one.annotation):
            yield from _parameters(one.annotation)
        else:
            yield one.replace(kind=inspect.Parameter.KEYWORD_ONLY)


def _has_fields(kind: type) -> bool:
    return is_dataclass(kind)


def _filled(made: Callable[..., Any], given: Mapping[str, Any]) -> Any:  # noqa: ANN401  (what it makes)
    return made(
        **{
            name: _filled(one.annotation, given) if _has_fields(one.annotation) else given[name]
            for name, one in inspect.signature(made).parameters.items()
        }
    )


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
        metavar="RECIPE",
        help="recipe file (YAML), or name of a recipe that comes with cellctl "
        "(default: recipe.yaml in this folder, else featuretype)",
    ),
]
CountedRecipesArg = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="RECIPE[=COUNT]",
        help="recipe file (YAML), or name of a recipe that comes with cellctl; with the number of "
        "parts to inspect (default: recipe.yaml in this folder, else featuretype)",
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
        help="parallel processes: a number, `all` for one per core, or the address of a Dask "
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
    Path, typer.Option("--runs", metavar="FOLDER", help="folder of runs and journal")
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
        rich_help_panel=EMULATED,
        help="times real time",
    ),
]
WallClockOption = Annotated[
    bool,
    typer.Option(
        "--wall-clock",
        rich_help_panel=EMULATED,
        help="let time run on while this computer is late, as in a real cell",
    ),
]
SeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed",
        metavar="N",
        min=0,
        max=2**32 - 1,
        rich_help_panel=EMULATED,
        help="seed: same seed, same world",
    ),
]
AsBuiltOption = Annotated[
    int | None,
    typer.Option(
        "--as-built",
        metavar="SEED",
        min=0,
        max=2**32 - 1,
        rich_help_panel=EMULATED,
        help="misplace the devices by some mm and degrees, as in a real cell, by this seed "
        "(default: exactly as in the cell file)",
    ),
]


class EmulatedFinish(StrEnum):
    """The appearance of parts in emulated pictures."""

    PLAIN = "plain"
    MACHINED = "machined"


SurfacesOption = Annotated[
    EmulatedFinish | None,
    typer.Option(
        "--surfaces",
        rich_help_panel=EMULATED,
        help="surface of the parts: plain, or with tool marks, dust, oil and light from wall "
        "to wall (default: machined with --as-built, else plain)",
    ),
]
EmulatedPoseOption = Annotated[
    int | None,
    typer.Option(
        "--pose",
        metavar="N",
        min=0,
        rich_help_panel=EMULATED,
        help="stable pose of the first part, as numbered by `cellctl compile` "
        "(default: by the seed)",
    ),
]
EmulatedAtOption = Annotated[
    str | None,
    typer.Option(
        "--at",
        metavar="X,Y,THETA_DEG",
        rich_help_panel=EMULATED,
        help="pose of the first part on the table (default: by the seed)",
    ),
]
ControlOption = Annotated[
    Path | None,
    typer.Option(
        "--control",
        metavar="FILE",
        rich_help_panel=EMULATED,
        help="unix socket on which tests inject faults",
    ),
]
UnitOption = Annotated[
    Unit | None,
    typer.Option("--unit", help="unit of CAD files that name none, such as STL (default: mm)"),
]
DensityOption = Annotated[
    float | None,
    typer.Option(
        "--density",
        metavar="X",
        min=0.01,
        max=25,
        callback=finite,
        help="density in g/cm3 (default: the CAD file's, else 2.7)",
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialOptions:
    """The options about serial numbers."""

    counted_from: Annotated[
        str | None,
        typer.Option(
            "--serial-from",
            metavar="NUMBER",
            rich_help_panel=REPORTED,
            help="first serial number; its last digits count up with each part",
        ),
    ] = None
    goes_on: Annotated[
        bool,
        typer.Option(
            "--across-runs",
            rich_help_panel=REPORTED,
            help="with --serial-from: continue after the last such number of earlier runs",
        ),
    ] = False
    is_read: Annotated[
        bool,
        typer.Option(
            "--scan",
            rich_help_panel=REPORTED,
            help="read each serial number first: from a scanner that types a line, or from "
            "`cellctl answer NUMBER`",
        ),
    ] = False
    serials: Annotated[
        list[str] | None,
        typer.Option(
            "--serial",
            metavar="NUMBER",
            rich_help_panel=REPORTED,
            help="serial number of a part; once per part, in order",
        ),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedOptions:
    """The options about an emulated cell that is entered, not run."""

    as_built: AsBuiltOption = None
    seed: SeedOption = None
    speed: SpeedOption = 1.0
    control: ControlOption = None
