"""The command line of `cellctl run`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from ..options import (
    EMULATED,
    MAX_PART_COUNT,
    REPORTED,
    AsBuiltOption,
    ControlOption,
    CountedRecipesArg,
    EmulatedAtOption,
    EmulatedPoseOption,
    JsonOption,
    RecipeCellOption,
    RunsOption,
    SeedOption,
    SerialOptions,
    SpeedOption,
    SurfacesOption,
    WallClockOption,
)

AFTER_A_STOP = "After a stop or a crash"  # title of a section of the help


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """The command line of `cellctl run`; what each option is stands in its help."""

    recipes: CountedRecipesArg = None
    cell_path: RecipeCellOption = None
    count: Annotated[
        int | None,
        typer.Option(
            "--count",
            metavar="N",
            min=1,
            max=MAX_PART_COUNT,
            help="parts to inspect of each recipe without a count (default: the recipe's)",
        ),
    ] = None
    operator: Annotated[
        str,
        typer.Option(
            "--operator", metavar="NAME", rich_help_panel=REPORTED, help="name of the operator"
        ),
    ] = ""
    lot: Annotated[
        str,
        typer.Option("--lot", metavar="LOT", rich_help_panel=REPORTED, help="lot of the parts"),
    ] = ""
    order_number: Annotated[
        str,
        typer.Option(
            "--order",
            metavar="NUMBER",
            rich_help_panel=REPORTED,
            help="number of the order (default: the recipe's `papers`)",
        ),
    ] = ""
    parts_list: Annotated[
        Path | None,
        typer.Option(
            "--parts-list",
            metavar="FILE",
            rich_help_panel=REPORTED,
            help="list of parts (CSV: recipe, serial, lot) in place of recipes",
        ),
    ] = None
    serials: SerialOptions = field(default_factory=SerialOptions)
    part_temperature_c: Annotated[
        float | None,
        typer.Option(
            "--part-temperature",
            metavar="DEG_C",
            min=-50,
            max=150,
            rich_help_panel=REPORTED,
            help="measured temperature of the parts",
        ),
    ] = None
    is_part_removed: Annotated[
        bool,
        typer.Option(
            "--part-removed",
            rich_help_panel=AFTER_A_STOP,
            help="state that you took the part out of the grippers; journaled",
        ),
    ] = False
    are_trays_empty: Annotated[
        bool,
        typer.Option(
            "--trays-empty",
            rich_help_panel=AFTER_A_STOP,
            help="state that the nests of all trays are empty; journaled",
        ),
    ] = False
    is_recovery_automatic: Annotated[
        bool,
        typer.Option(
            "--auto-recover",
            rich_help_panel=AFTER_A_STOP,
            help="go on with a part in a gripper where that is proven safe",
        ),
    ] = False
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="FILE",
            help="record every byte and frame on the wires, with its time, for `cellctl replay "
            "--wires`",
        ),
    ] = None
    waits: Annotated[
        bool,
        typer.Option(
            "--wait",
            help="wait for `cellctl answer` where a person has to decide, also without a terminal",
        ),
    ] = False
    is_stepwise: Annotated[
        bool,
        typer.Option(
            "--step",
            help="ask before each motion: Enter, or `cellctl answer go` from another terminal",
        ),
    ] = False
    is_dry: Annotated[
        bool,
        typer.Option(
            "--dry",
            help="drive all motions without a part: clear of everything, at a tenth of the speed, "
            "grippers open; for the stable pose of --pose (default: the likeliest)",
        ),
    ] = False
    speed: SpeedOption = 1.0
    is_on_wall_clock: WallClockOption = False
    seed: SeedOption = None
    as_built: AsBuiltOption = None
    surfaces: SurfacesOption = None
    lay: Annotated[
        list[Path] | None,
        typer.Option(
            "--lay",
            metavar="PART",
            rich_help_panel=EMULATED,
            help="CAD file of a part to put on the table; may be repeated "
            "(default: the part of each recipe)",
        ),
    ] = None
    on_table: Annotated[
        int | None,
        typer.Option(
            "--on-table",
            metavar="N",
            min=1,
            rich_help_panel=EMULATED,
            help="parts on the table at a time; the next one comes once one is in its tray "
            "(default: all of them)",
        ),
    ] = None
    empty: Annotated[
        bool, typer.Option("--empty", rich_help_panel=EMULATED, help="leave the table empty")
    ] = False
    pose: EmulatedPoseOption = None
    at: EmulatedAtOption = None
    control: ControlOption = None
    runs_dir: RunsOption = Path("runs")
    as_json: JsonOption = False
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", "-v", help="log to stderr; print the details of an unexpected error"
        ),
    ] = False
