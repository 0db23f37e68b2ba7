"""Changes the accounts of the page and of plant systems."""

import secrets
import sys
from getpass import getpass
from typing import Final

from controller.config import ConfigError
from controller.page.security import Accounts, AccountsError, Role, accounts_path, require_name

from ..terminal.output import emit, print_line

MADE_BYTES: Final = 24


def change_accounts(
    name: str | None, role: str | None, *, is_removed: bool, is_made: bool, as_json: bool
) -> int:
    """List, add, change or remove accounts; return 0.

    Parameters
    ----------
    name : name of the account, None for all
    role : role to give, None to keep it
    is_removed : remove it
    is_made : make its password, and print it
    as_json : print one JSON object for each account that is there then

    Raises
    ------
    ConfigError : name, role or password cannot be taken, or the file of accounts is wrong
    """
    accounts = Accounts(accounts_path())
    made = secrets.token_urlsafe(MADE_BYTES) if is_made else ""
    try:
        if is_made and role is None:
            raise ConfigError("--generate requires --role ROLE")
        if name is None:
            if role is not None or is_removed:
                raise ConfigError("name the account")
        elif is_removed:
            if role is not None:
                raise ConfigError("--remove and --role exclude each other")
            accounts.remove(name)
        elif role is None:
            raise ConfigError(f"{name}: give --role ROLE to add or change the account, or --remove")
        else:
            require_name(name)  # before a password is typed for nothing
            accounts.put(name, Role[role.upper()], made or _password())
        found = accounts.names()
    except AccountsError as error:
        raise ConfigError(str(error)) from error
    for one, its_role in sorted(found.items()):
        if as_json:
            shown = {"password": made} if made and one == name else {}
            emit({"event": "account", "name": one, "role": its_role.word, **shown})
        else:
            shown_too = f", password {made} (shown this once)" if made and one == name else ""
            print_line(f"{one}: {its_role.word}{shown_too}")
    if not found and not as_json:
        print_line("no account; `cellctl account NAME --role operator` adds one")
    return 0


def _password() -> str:
    """Return a password: typed twice at a terminal, else the first line of stdin."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\n")
    first = getpass("password: ")
    if getpass("once more: ") != first:
        raise ConfigError("the two passwords differ")
    return first
