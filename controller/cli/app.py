"""The command line. Each command is thin: parse, build, run, one sentence and an exit code.

Exit codes: 0 done, 1 the cell or the part said no, 2 the command line or a file is wrong.
"""

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from .commands import (
    calibrate,
    check,
    doctor,
    emulate,
    init,
    plan,
    recognise,
    recover,
    report,
    run,
)
from .commands import (
    compile as compile_command,
)

app = typer.Typer(
    name="cellctl",
    help="Run a robotic inspection cell: recognise, grasp, present, inspect and sort machined "
    "parts from their CAD models.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
calibration = typer.Typer(
    help="Measure what the cell must know about itself.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from .terminal.version import installed_version

        typer.echo(f"cellctl {installed_version()}")
        raise typer.Exit


@app.callback()
def _common(
    verbose: Annotated[
        bool, typer.Option("--verbose", help="print the details of an unexpected error")
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="print the version and exit"
        ),
    ] = False,
) -> None:
    pass


for _command, _name, _example in (
    (init.init, "init", init.EXAMPLE),
    (run.run, "run", run.EXAMPLE),
    (recover.recover, "recover", recover.EXAMPLE),
    (check.check, "check", check.EXAMPLE),
    (compile_command.compile_, "compile", compile_command.EXAMPLE),
    (recognise.recognise, "recognise", recognise.EXAMPLE),
    (plan.plan, "plan", plan.EXAMPLE),
    (emulate.emulate, "emulate", emulate.EXAMPLE),
    (report.report, "report", report.EXAMPLE),
    (doctor.doctor, "doctor", doctor.EXAMPLE),
):
    app.command(name=_name, epilog=f"Example: {_example}")(_command)
calibration.command(name="camera", epilog=f"Example: {calibrate.CAMERA_EXAMPLE}")(calibrate.camera)
app.add_typer(calibration, name="calibrate")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code; nobody ever reads a traceback unasked."""
    words = sys.argv[1:] if argv is None else list(argv)
    try:
        app(args=list(argv) if argv is not None else None, prog_name="cellctl")
    except SystemExit as end:  # how the parser ends each command, and each wrong command line
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except (KeyboardInterrupt, Exception) as error:  # noqa: BLE001  (each becomes a sentence)
        from .terminal.failure import report_failure

        return report_failure(error, words)
    return 0


if __name__ == "__main__":
    sys.exit(main())
