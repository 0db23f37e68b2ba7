"""The parser: all commands, help, version, completion; an error becomes a sentence and a code.

Exit codes: 0 done; 1 the cell or a part does not allow it; 2 the command line or a file is wrong.
"""

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from .acting import abort, ack, answer, pause, resume, status, step, stop, watch
from .bring_up import commission, jog, print_target, teach
from .calibrating import camera
from .devices import doctor, emulate
from .history import backup, history, rejudge, review
from .inspecting import inspect, replay, verify
from .learning import learn
from .parts import compile_
from .planning import check, plan
from .plant import connect, deliveries, orders
from .project import init
from .recognising import recognise
from .running import recover, report, run
from .serving import account, serve
from .statistics import gauge, stats
from .terminal.help import PlainCommand, PlainGroup

app = typer.Typer(
    cls=PlainGroup,
    name="cellctl",
    help="Run a robotic inspection cell: recognise, grasp, present, inspect and sort machined "
    "parts from their CAD models.",
    epilog="Exit codes: 0 done, and every part passed; 1 a part did not pass, or the cell stopped; "
    "2 the command line or a file is wrong.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
calibration = typer.Typer(
    cls=PlainGroup,
    help="Calibrate a camera from pictures of a board.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from controller.setup.software import commit, installed_version

        typer.echo(f"cellctl {installed_version()}, commit {commit()}")
        raise typer.Exit


@app.callback()
def _common(
    verbose: Annotated[
        bool, typer.Option("--verbose", help="print the details of an unexpected error")
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="print version and commit, and exit",
        ),
    ] = False,
) -> None:
    pass


# Title of each section of `cellctl --help`, its commands in order, and examples of each to copy.
_SECTIONS = {
    "Run a cell": (
        (
            run,
            "cellctl run featuretype --speed 10",
            "cellctl run holder=3 idler_riser=2 --on-table 2 --speed 10",
            "cellctl run flange_xy --seed 7",
            "cellctl run holder --at 330,40,120 --pose 1",
        ),
        (recover, "cellctl recover --cell cell.yaml --open arm"),
        (status, "cellctl status"),
        (watch, "cellctl watch"),
        (pause, 'cellctl pause now --why "a screw fell on the table"'),
        (resume, "cellctl resume"),
        (step, "cellctl step"),
        (stop, "cellctl stop"),
        (abort, "cellctl abort"),
        (ack, 'cellctl ack --why "the door was opened by mistake, the cell is clear"'),
        (answer, 'cellctl answer look --why "the part lies beside the tray"'),
        (serve, "cellctl serve --runs runs"),
        (account, "cellctl account anna --role operator"),
    ),
    "Connect a plant": (
        (connect, "cellctl connect --cell cell.yaml"),
        (deliveries, "cellctl deliveries"),
        (orders, "cellctl orders --release PO-4711"),
    ),
    "Prepare a part": (
        (init, "cellctl init my_project --part plate.step"),
        (check, "cellctl check flange_xy"),
        (compile_, "cellctl compile bracket.stl --report bracket.html"),
        (
            plan,
            "cellctl plan --recipe featuretype --report featuretype.html",
            "cellctl plan bracket.stl cover.stl --site --cell cell.yaml",
        ),
    ),
    "Judge and report": (
        (recognise, "cellctl recognise table.png --parts parts --calibration camera.json"),
        (inspect, "cellctl inspect part_17/SET.json --report part_17.html"),
        (learn, "cellctl learn --runs runs --accepted --recipe holder -o holder.learned"),
        (report, "cellctl report --format json"),
        (verify, "cellctl verify 20260314-092641-512-holder"),
    ),
    "History": (
        (history, "cellctl history --recipe holder --verdict fail --since 2026-03-01"),
        (review, 'cellctl review SN-0042 --verdict accept --why "a reflection"'),
        (
            rejudge,
            "cellctl rejudge --recipe stricter.yaml --since 2026-03-01 -o turned.csv",
            "cellctl rejudge --recipe holder --jobs tcp://192.168.1.5:8786",
        ),
        (
            stats,
            "cellctl stats featuretype --report featuretype.html",
            "cellctl stats --by day --since 2026-03-01",
            "cellctl stats --takt",
            "cellctl stats --review",
        ),
        (gauge, "cellctl gauge A=part_a/SET.json A=part_a_regrasped/SET.json"),
        (backup, "cellctl backup /mnt/backup/cell.tar.gz"),
    ),
    "Commission": (
        (doctor, "cellctl doctor --cell cell.yaml"),
        (commission, "cellctl commission --cell cell.yaml"),
        (jog, "cellctl jog --cell cell.yaml"),
        (teach, "cellctl teach accept --cell cell.yaml"),
        (print_target, "cellctl print-target paddle --paper a4 -o paddle.pdf"),
    ),
    "Develop": (
        (emulate, "cellctl emulate --part bracket.stl --speed 5"),
        (replay, "cellctl replay --recipe stricter.yaml"),
    ),
}
for _title, _commands in _SECTIONS.items():
    for _command, *_examples in _commands:
        app.command(
            name=_command.__name__.rstrip("_").replace("_", "-"),
            cls=PlainCommand,
            epilog="\n".join(_examples),
            rich_help_panel=_title,
        )(_command)
calibration.command(
    name="camera",
    cls=PlainCommand,
    epilog="cellctl calibrate camera board_*.png --target board.json -o camera.json",
)(camera)
app.add_typer(calibration, name="calibrate", rich_help_panel="Commission")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; return its exit code. A traceback is printed on request only."""
    words = sys.argv[1:] if argv is None else list(argv)
    try:
        app(args=list(argv) if argv is not None else None, prog_name="cellctl")
    except SystemExit as end:  # the parser ends every command so, wrong ones too
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except (KeyboardInterrupt, Exception) as error:  # noqa: BLE001  (each becomes a sentence)
        from .terminal.failure import report_failure

        return report_failure(error, words)
    return 0


if __name__ == "__main__":
    sys.exit(main())
