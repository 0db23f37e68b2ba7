"""The command lines of `cellctl commission`, `jog` and `teach`."""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, ClassVar

import typer

from ..options import EmulatedOptions, JsonOption, RunsOption

OperatorOption = Annotated[
    str, typer.Option("--operator", metavar="NAME", help="your name (default: the user)")
]


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedOptions:
    """The command line of `cellctl commission`; what each option is stands in its help."""

    cell_path: Annotated[
        Path,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML) as drawn; it stays as it is"),
    ]
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="folder for the new cell file, calibrations and evidence (default: "
            "commissioning/NAME of the cell)",
        ),
    ] = None
    step: Annotated[
        str | None,
        typer.Option("--step", metavar="NAME", help="repeat one step (default: all that are due)"),
    ] = None
    status: Annotated[
        bool,
        typer.Option(
            "--status", help="print which steps are done and which calibrations are valid"
        ),
    ] = False
    answers: Annotated[
        bool, typer.Option("--yes", help="answer for the person; emulated cells only")
    ] = False
    recipes: Annotated[
        list[Path] | None,
        typer.Option(
            "--recipe",
            metavar="FILE",
            help="recipe whose poses the step `reach` plans; may be repeated (default: the recipes "
            "beside the cell file)",
        ),
    ] = None
    operator: OperatorOption = ""
    emulated: EmulatedOptions = field(default_factory=EmulatedOptions)
    runs_dir: RunsOption = Path("runs")
    as_json: JsonOption = False


@dataclass(frozen=True, slots=True, kw_only=True)
class JogOptions:
    """The command line of `cellctl jog`; `name` is that of the command."""

    name: ClassVar[str] = "jog"
    cell_path: Annotated[
        Path, typer.Option("--cell", metavar="FILE", help="cell file (YAML), calibrated or not")
    ]
    commands: Annotated[
        Path | None,
        typer.Option(
            "--commands",
            metavar="FILE",
            help="file of orders, one per line; `-` for standard input (default: keys of this "
            "terminal)",
        ),
    ] = None
    answers: Annotated[
        bool,
        typer.Option("--yes", help="with --commands: answer for the person; emulated cells only"),
    ] = False
    operator: OperatorOption = ""
    emulated: EmulatedOptions = field(default_factory=EmulatedOptions)
    runs_dir: RunsOption = Path("runs")
    as_json: JsonOption = False

    @property
    def takes(self) -> str:
        """What the order `take` does; empty if there is no such order."""
        return ""


class Teachable(StrEnum):
    """Positions that can be taught."""

    ACCEPT = "accept"
    REJECT = "reject"
    QUARANTINE = "quarantine"
    PARK = "park"
    STATION = "station"


@dataclass(frozen=True, slots=True, kw_only=True)
class TeachOptions(JogOptions):
    """The command line of `cellctl teach`: that of `jog`, and the position to take."""

    name: ClassVar[str] = "teach"
    what: Annotated[
        Teachable,
        typer.Argument(
            metavar="WHAT", help="accept, reject or quarantine (the trays), park or station"
        ),
    ]
    cell_path: Annotated[
        Path,
        typer.Option("--cell", metavar="FILE", help="cell file (YAML) to write the position to"),
    ]
    answers: Annotated[
        bool,
        typer.Option(
            "--yes",
            help="with --commands: answer for the person, and write; emulated cells only",
        ),
    ] = False

    @property
    def takes(self) -> str:
        """What the order `take` does."""
        return f"takes the position of `{self.what}`"
