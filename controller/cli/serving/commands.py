"""Arguments and help of the commands about the page."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, RunsOption

RUNS = Path("runs")


class RoleName(StrEnum):
    """The role of an account."""

    PLANT = "plant"
    VIEWER = "viewer"
    OPERATOR = "operator"
    ENGINEER = "engineer"


def serve(
    runs: RunsOption = RUNS,
    host: Annotated[
        str,
        typer.Option(
            "--host",
            metavar="ADDRESS",
            help="address to listen on; any but this machine's own needs --tls-cert and --tls-key, "
            "or --behind",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", metavar="PORT", min=1, max=65535, help="port to listen on")
    ] = 8470,
    tls_cert: Annotated[
        Path | None, typer.Option("--tls-cert", metavar="FILE", help="certificate for https (PEM)")
    ] = None,
    tls_key: Annotated[
        Path | None,
        typer.Option("--tls-key", metavar="FILE", help="private key of the certificate (PEM)"),
    ] = None,
    behind: Annotated[
        str | None,
        typer.Option(
            "--behind",
            metavar="ORIGIN",
            help="origin https://NAME under which a reverse proxy on this machine, or at the "
            "addresses of --proxy, serves the page",
        ),
    ] = None,
    proxy: Annotated[
        list[str] | None,
        typer.Option(
            "--proxy", metavar="ADDRESS", help="address of that proxy (default: this machine)"
        ),
    ] = None,
    name: Annotated[
        list[str] | None,
        typer.Option("--name", metavar="NAME", help="host name by which browsers reach the page"),
    ] = None,
    recipes: Annotated[
        Path | None,
        typer.Option(
            "--recipes",
            metavar="FOLDER",
            help="folder of the recipes and the cell file that engineers may change (default: "
            "this folder)",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Serve the web page that shows and operates the cell.

    Prints a link that logs in. Needs `pip install 'cellctl[page]'`.
    """
    with loading():
        from .server import serve_page

    raise typer.Exit(
        serve_page(
            runs,
            recipes or Path.cwd(),
            host,
            port,
            (tls_cert, tls_key),
            behind,
            tuple(proxy or ()),
            tuple(name or ()),
            as_json=json,
        )
    )


def account(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="name of the account (default: list all)")
    ] = None,
    role: Annotated[
        RoleName | None,
        typer.Option(
            "--role",
            help="add the account, or change its role; asks for a password; `plant`: a plant "
            "system at the wires of `cellctl connect`",
        ),
    ] = None,
    generate: Annotated[
        bool, typer.Option("--generate", help="make the password, and print it once")
    ] = False,
    remove: Annotated[bool, typer.Option("--remove", help="remove the account")] = False,
    json: JsonOption = False,
) -> None:
    """List, add, change or remove accounts of people and plants."""
    with loading():
        from .people import change_accounts

    role_word = None if role is None else role.value
    raise typer.Exit(
        change_accounts(name, role_word, is_removed=remove, is_made=generate, as_json=json)
    )
