"""The command line. Each command is thin: parse, build, run, one sentence and an exit code.

Exit codes: 0 done, 1 the cell or the part said no, 2 the command line or a file is wrong.
"""

import os
import sys
from collections.abc import Sequence
from enum import StrEnum
from math import isnan
from pathlib import Path
from typing import Annotated

import typer

from controller.cad import CadError
from controller.cell.errors import CellError
from controller.cell.journal import JournalError
from controller.config import ConfigError
from controller.planning import NoPlanError
from controller.results import ResultsError
from drivers.errors import DeviceError

from ._bug import report_bug
from ._emulator import EmulatorError
from ._output import warn

app = typer.Typer(
    name="cellctl",
    help="Runs a robotic inspection cell: recognises, grasps, shows, checks and sorts machined "
    "parts from their CAD models.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
calibrate = typer.Typer(
    help="Measure what the cell must know about itself.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(calibrate, name="calibrate")


MOST_PARTS = 100_000  # of one run, as in a recipe


class Unit(StrEnum):
    """A unit of length."""

    MM = "mm"
    CM = "cm"
    M = "m"
    INCH = "inch"


def _finite(value: float | None) -> float | None:
    """Refuse what is no number, which passes every limit."""
    if value is not None and isnan(value):
        raise typer.BadParameter("nan is no number")
    return value


RecipeArg = Annotated[Path, typer.Argument(help="recipe file (YAML)")]
CellOption = Annotated[
    Path | None, typer.Option("--cell", help="cell file (YAML); the recipe's cell otherwise")
]
JsonOption = Annotated[bool, typer.Option("--json", help="one JSON object a line on stdout")]
RunsOption = Annotated[Path, typer.Option("--runs", help="folder of all runs and the journal")]
SpeedOption = Annotated[
    float,
    typer.Option(
        "--speed", min=0.1, max=100, callback=_finite, help="emulated cell: times real time"
    ),
]
SeedOption = Annotated[
    int | None,
    typer.Option("--seed", min=0, max=2**32 - 1, help="emulated cell: same seed, same world"),
]
LayOption = Annotated[
    list[Path] | None,
    typer.Option("--lay", help="emulated cell: CAD of what lies on the table; may be repeated"),
]
EmptyOption = Annotated[bool, typer.Option("--empty", help="emulated cell: an empty table")]
PoseOption = Annotated[
    int | None,
    typer.Option("--pose", min=0, help="emulated cell: which stable pose the part lies in"),
]
AtOption = Annotated[
    str | None, typer.Option("--at", help="emulated cell: where it lies, as X,Y,THETA_DEG")
]
ControlOption = Annotated[
    Path | None,
    typer.Option("--control", help="emulated cell: unix socket for injecting faults in tests"),
]
UnitOption = Annotated[
    Unit | None,
    typer.Option("--unit", help="of CAD files that name none, as STL; mm is assumed otherwise"),
]
VerboseOption = Annotated[bool, typer.Option("--verbose", "-v", help="log to stderr")]


class Lighting(StrEnum):
    """How a stored picture was lit."""

    AUTO = "auto"
    BACKLIT = "backlit"
    FRONT = "front"


class Form(StrEnum):
    """What a report is written as."""

    HTML = "html"
    JSON = "json"


class Lines(StrEnum):
    """What the emulated Modbus lines are."""

    TCP = "tcp"
    RTU_PTY = "rtu-pty"
    RTU_TCP = "rtu-tcp"


@app.callback()
def _common(
    verbose: Annotated[
        bool, typer.Option("--verbose", help="print the details of an error nobody expected")
    ] = False,
) -> None:
    """Run a robotic inspection cell."""


@app.command(epilog="Example: cellctl run recipes/featuretype.yaml --speed 10")
def run(
    recipe: RecipeArg,
    cell: CellOption = None,
    count: Annotated[
        int | None, typer.Option("--count", min=1, max=MOST_PARTS, help="how many parts")
    ] = None,
    speed: SpeedOption = 1.0,
    seed: SeedOption = None,
    lay: LayOption = None,
    empty: EmptyOption = False,
    pose: PoseOption = None,
    at: AtOption = None,
    control: ControlOption = None,
    part_removed: Annotated[
        bool,
        typer.Option(
            "--part-removed", help="state that you took the part out of the grippers; journaled"
        ),
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
    verbose: VerboseOption = False,
) -> None:
    """Inspect and sort parts: the main job. Emulated devices are started beside it."""
    from ._run import quiet_logs, run_recipe

    quiet_logs(verbose=verbose)
    code = run_recipe(
        recipe,
        cell,
        count=count,
        speed=speed,
        seed=seed,
        lay=tuple(lay or ()),
        empty=empty,
        pose=pose,
        at=at,
        control=control,
        runs_dir=runs,
        is_part_removed=part_removed,
        as_json=json,
    )
    raise typer.Exit(code)


class Gripper(StrEnum):
    """Which gripper."""

    ARM = "arm"
    FIXED = "fixed"


@app.command(epilog="Example: cellctl recover --cell cell.yaml --open arm")
def recover(
    cell: Annotated[Path, typer.Option("--cell", help="cell file (YAML)")] = Path(
        "recipes/cells/emulated.yaml"
    ),
    open_: Annotated[
        Gripper | None,
        typer.Option("--open", help="open this gripper while you hold the part; no arm motion"),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="state that the part is held, without being asked")
    ] = False,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Report what the grippers may hold after a crash or a stop; open one for you."""
    from controller.cell.custody import GripperName

    from ._recover import recover_cell

    names = {Gripper.ARM: GripperName.ARM, Gripper.FIXED: GripperName.FIXED}
    gripper = None if open_ is None else names[open_]
    raise typer.Exit(recover_cell(cell, runs, gripper, is_confirmed=yes, as_json=json))


@app.command(epilog="Example: cellctl check recipes/flange_xy.yaml")
def check(recipe: RecipeArg, cell: CellOption = None, json: JsonOption = False) -> None:
    """Find everything that can be wrong before anything moves: files, CAD, grips, views, reach."""
    from ._offline import check_recipe

    raise typer.Exit(check_recipe(recipe, cell, as_json=json))


@app.command(
    name="compile",
    epilog="Example: cellctl compile recipes/parts/featuretype.stl --report featuretype.html",
)
def compile_(
    parts: Annotated[
        list[Path] | None, typer.Argument(help="CAD files (default: the recipe's part)")
    ] = None,
    recipe: Annotated[
        Path | None,
        typer.Option(
            "--recipe", help="recipe (YAML): plan in its cell, with its density, grip and views"
        ),
    ] = None,
    unit: UnitOption = None,
    density: Annotated[
        float | None,
        typer.Option(
            "--density",
            min=0.01,
            max=25,
            callback=_finite,
            help="g/cm3; the file's, or 2.7, otherwise",
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option("--cell", help="cell file (YAML): tell how the part is held and shown there"),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="HTML page to write, with every pose drawn")
    ] = None,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="compile anew, and keep nothing")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Show what follows from a CAD file: ways to lie and their odds, outlines, surfaces, edges."""
    from ._compile import compile_parts
    from ._planned_parts import part_files

    recipes = [recipe] if recipe is not None else []
    files, recipe_cell = part_files(list(parts or ()), recipes, unit and unit.value, cell)
    code = compile_parts(
        files,
        density_g_cm3=density,
        report=report,
        cell=recipe_cell if recipes else cell,
        use_cache=not no_cache,
        as_json=json,
    )
    raise typer.Exit(code)


@app.command(
    epilog="Example: cellctl recognise table.png --parts recipes/parts --calibration camera.json"
)
def recognise(
    images: Annotated[list[Path], typer.Argument(help="pictures of the table, or folders of them")],
    parts: Annotated[list[Path], typer.Option("--parts", help="CAD files, or folders of them")],
    calibration: Annotated[Path, typer.Option("--calibration", help="camera calibration (JSON)")],
    lighting: Annotated[
        Lighting, typer.Option("--lighting", help="how the table was lit")
    ] = Lighting.AUTO,
    explain: Annotated[
        Path | None,
        typer.Option("--explain", help="folder for a drawing and tables of how each answer came"),
    ] = None,
    unit: UnitOption = None,
    json: JsonOption = False,
) -> None:
    """Say what lies on the table in stored pictures: part, stable pose, place, or "unknown"."""
    from ._recognise import recognise_images

    code = recognise_images(
        images,
        parts,
        calibration,
        lighting.value,
        unit=unit and unit.value,
        as_json=json,
        explain_in=explain,
    )
    raise typer.Exit(code)


@calibrate.command(
    name="camera",
    epilog="Example: cellctl calibrate camera board_*.png --target board.json -o camera.json",
)
def calibrate_camera(
    images: Annotated[list[Path], typer.Argument(help="pictures of the board, flat and tilted")],
    target: Annotated[
        Path, typer.Option("--target", help="the board, and how it lies in each picture (JSON)")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="calibration file to write")],
    json: JsonOption = False,
) -> None:
    """Measure a camera, its lens and its place over the table from pictures of a board."""
    from ._calibrate import calibrate_camera as calibrate_from_files

    raise typer.Exit(calibrate_from_files(images, target, output, as_json=json))


@app.command(
    epilog="Example: cellctl plan --recipe recipes/featuretype.yaml --report featuretype.html"
)
def plan(
    parts: Annotated[
        list[Path] | None,
        typer.Argument(help="CAD file; several with --site (default: the recipe's part)"),
    ] = None,
    recipe: Annotated[
        list[Path] | None,
        typer.Option(
            "--recipe",
            help="recipe (YAML) whose density, grip and views count; may be repeated with --site",
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option(
            "--cell",
            help="cell file (YAML) (default: the recipe's, or recipes/cells/emulated.yaml)",
        ),
    ] = None,
    pose: Annotated[
        int | None,
        typer.Option("--pose", help="stable pose it lies in; all of them are tried otherwise"),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option("--at", help="where it lies, as X,Y,THETA_DEG; mid drop area otherwise"),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="HTML page to write, with every step drawn")
    ] = None,
    unit: UnitOption = None,
    site: Annotated[
        bool,
        typer.Option("--site", help="where camera and fixed gripper should stand for the parts"),
    ] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="plan anew, and keep nothing")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Plan how a part would be shown: steps, forecast, coverage, and why not the rest."""
    from ._planned_parts import part_files

    files, cell_file = part_files(list(parts or ()), list(recipe or ()), unit and unit.value, cell)
    if site:
        asked = {"--pose": pose, "--at": at, "--report": report}
        for name, value in asked.items():
            if value is not None:
                raise ConfigError(f"--site is about the cell: it goes without {name}")
        from ._plan_site import site_parts

        code = site_parts(files, cell_file, use_cache=not no_cache, as_json=json)
        raise typer.Exit(code)
    if len(files) > 1:
        second = files[1].path
        raise ConfigError(f"{second}: one part is planned at a time; several only with --site")
    from ._plan import plan_part_file

    code = plan_part_file(
        files[0],
        cell_file,
        pose,
        at,
        report=report,
        use_cache=not no_cache,
        as_json=json,
    )
    raise typer.Exit(code)


@app.command(epilog="Example: cellctl emulate --part recipes/parts/holder.stl --speed 5")
def emulate(
    cell: Annotated[Path, typer.Option("--cell", help="cell file (YAML)")] = Path(
        "recipes/cells/emulated.yaml"
    ),
    part: Annotated[
        list[Path] | None, typer.Option("--part", help="CAD of what lies on the table")
    ] = None,
    speed: SpeedOption = 1.0,
    seed: SeedOption = None,
    pose: PoseOption = None,
    at: AtOption = None,
    control: ControlOption = None,
    lines: Annotated[
        Lines | None, typer.Option("--lines", help="what the Modbus lines are")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Bring up the emulated cell on its ports for any client; Ctrl-C ends it."""
    from ._emulate import serve

    code = serve(
        cell,
        tuple(part or ()),
        speed=speed,
        seed=seed,
        pose=pose,
        at=at,
        control=control,
        lines=lines and lines.value,
        as_json=json,
    )
    raise typer.Exit(code)


@app.command(epilog="Example: cellctl report --format json")
def report(
    run_name: Annotated[
        str | None, typer.Argument(metavar="[RUN]", help="run, the newest otherwise")
    ] = None,
    form: Annotated[Form, typer.Option("--format", help="what to write")] = Form.HTML,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="file to write")] = None,
    runs: RunsOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Write what a run found."""
    from ._report import write_report

    raise typer.Exit(write_report(runs, run_name, "json" if json else form.value, output))


@app.command(epilog="Example: cellctl doctor --cell recipes/cells/emulated.yaml")
def doctor(
    cell: Annotated[Path, typer.Option("--cell", help="cell file (YAML)")] = Path(
        "recipes/cells/emulated.yaml"
    ),
    json: JsonOption = False,
) -> None:
    """Check what a run needs: every device reachable and the right one, versions, permissions."""
    from ._doctor import examine

    raise typer.Exit(examine(cell, as_json=json))


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code; nobody ever reads a traceback unasked."""
    words = sys.argv[1:] if argv is None else list(argv)
    is_verbose = "--verbose" in words or "-v" in words
    try:
        app(args=list(argv) if argv is not None else None, prog_name="cellctl")
    except SystemExit as end:  # how the parser ends each command, and each wrong command line
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except (ConfigError, CadError) as error:
        warn(f"cellctl: {error}")
        return 2
    except (
        CellError,
        DeviceError,
        EmulatorError,
        JournalError,
        NoPlanError,
        ResultsError,
    ) as error:
        warn(f"cellctl: {error}")
        return 1
    except KeyboardInterrupt:
        warn("cellctl: given up")
        return 1
    except OSError as error:
        if error.strerror is None:
            report_bug(error, words, verbose=is_verbose)
            return 1
        where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
        warn(f"cellctl: {where}{error.strerror}")
        return 1
    except Exception as error:  # noqa: BLE001  (the last resort: a sentence, the rest in a file)
        report_bug(error, words, verbose=is_verbose)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
