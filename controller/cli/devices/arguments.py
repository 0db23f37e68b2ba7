"""The command line of `cellctl emulate`."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..options import (
    AsBuiltOption,
    CellOption,
    ControlOption,
    EmulatedAtOption,
    EmulatedPoseOption,
    JsonOption,
    SeedOption,
    SpeedOption,
    SurfacesOption,
    WallClockOption,
)


class Lines(StrEnum):
    """Transport of the emulated Modbus lines."""

    TCP = "tcp"
    RTU_PTY = "rtu-pty"
    RTU_TCP = "rtu-tcp"


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulateOptions:
    """The command line of `cellctl emulate`; what each option is stands in its help."""

    cell_path: CellOption = None
    parts: Annotated[
        list[Path] | None,
        typer.Option(
            "--part",
            metavar="PART",
            help="CAD file of a part to put on the table; may be repeated (default: none)",
        ),
    ] = None
    speed: SpeedOption = 1.0
    is_on_wall_clock: WallClockOption = False
    seed: SeedOption = None
    as_built: AsBuiltOption = None
    surfaces: SurfacesOption = None
    pose: EmulatedPoseOption = None
    at: EmulatedAtOption = None
    control: ControlOption = None
    lines: Annotated[
        Lines | None, typer.Option("--lines", help="transport of the Modbus lines (default: tcp)")
    ] = None
    as_json: JsonOption = False
