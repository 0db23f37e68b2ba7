"""The command line of `cellctl serve`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ..options import JsonOption, RunsOption


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeOptions:
    """The command line of `cellctl serve`; what each option is stands in its help."""

    runs_dir: RunsOption = Path("runs")
    host: Annotated[
        str,
        typer.Option(
            "--host",
            metavar="ADDRESS",
            help="address to listen on; any but this machine's own needs --tls-cert and --tls-key, "
            "or --behind",
        ),
    ] = "127.0.0.1"
    port: Annotated[
        int, typer.Option("--port", metavar="PORT", min=1, max=65535, help="port to listen on")
    ] = 8470
    tls_cert: Annotated[
        Path | None, typer.Option("--tls-cert", metavar="FILE", help="certificate for https (PEM)")
    ] = None
    tls_key: Annotated[
        Path | None,
        typer.Option("--tls-key", metavar="FILE", help="private key of the certificate (PEM)"),
    ] = None
    behind: Annotated[
        str | None,
        typer.Option(
            "--behind",
            metavar="ORIGIN",
            help="origin https://NAME under which a reverse proxy on this machine, or at the "
            "addresses of --proxy, serves the page",
        ),
    ] = None
    proxies: Annotated[
        list[str] | None,
        typer.Option(
            "--proxy", metavar="ADDRESS", help="address of that proxy (default: this machine)"
        ),
    ] = None
    names: Annotated[
        list[str] | None,
        typer.Option("--name", metavar="NAME", help="host name by which browsers reach the page"),
    ] = None
    project_dir: Annotated[
        Path | None,
        typer.Option(
            "--recipes",
            metavar="FOLDER",
            help="folder of the recipes and the cell file that engineers may change (default: "
            "this folder)",
        ),
    ] = None
    as_json: JsonOption = False
