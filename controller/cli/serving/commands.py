"""Arguments and help of the commands about the page."""

from enum import StrEnum
from typing import Annotated

import typer

from controller.loading import loading

from ..options import JsonOption, from_fields
from .arguments import ServeOptions


class RoleName(StrEnum):
    """The role of an account."""

    PLANT = "plant"
    VIEWER = "viewer"
    OPERATOR = "operator"
    ENGINEER = "engineer"


@from_fields
def serve(options: ServeOptions) -> None:
    """Serve the web page that shows and operates the cell.

    Prints a link that logs in. Needs `pip install 'cellctl[page]'`.
    """
    with loading():
        from .server import serve_page

    raise typer.Exit(serve_page(options))


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
