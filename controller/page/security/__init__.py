"""Access to the page and to orders: accounts, sessions, and a guard before all else."""

from .accounts import Account, Accounts, AccountsError, Role, accounts_path, require_name
from .addresses import PageAddress
from .guard import Guard
from .sessions import Attempts, BrowserSession, Sessions, sessions_path

__all__ = [
    "Account",
    "Accounts",
    "AccountsError",
    "Attempts",
    "BrowserSession",
    "Guard",
    "PageAddress",
    "Role",
    "Sessions",
    "accounts_path",
    "require_name",
    "sessions_path",
]
