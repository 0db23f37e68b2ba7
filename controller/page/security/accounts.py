"""The local accounts of the page: a file of this user, with a hash of each password."""

import json
import os
import re
import secrets
from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from hashlib import scrypt, sha256
from hmac import compare_digest
from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .private_file import SharedFileError, read_private, write_private

# scrypt's cost (RFC 7914): 16 MiB and about a quarter of a second for each password that is
# tried. Five passes at 2**14 are held to be as strong as one at 2**17, which takes 128 MiB (OWASP,
# Password Storage Cheat Sheet), as much as all the rest of `cellctl connect`
COST: Final = 2**14
PASSES: Final = 5
BLOCK: Final = 8
# bytes that OpenSSL takes beside the requirement of scrypt by its definition
SPARE_BYTES: Final = 2**20
MAX_ACCOUNT_COUNT: Final = 200
MIN_PASSWORD: Final = 10
MAX_PASSWORD: Final = 200
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,39}")


class AccountsError(Exception):
    """The accounts cannot be read or changed."""


class Role(IntEnum):
    """Rights of an account; each role includes those of the one before it."""

    PLANT = 0
    """A plant system at the wires of `cellctl connect`; the page is closed to it."""
    VIEWER = 1
    """Look."""
    OPERATOR = 2
    """Pause, resume, stop, answer."""
    ENGINEER = 3
    """What changes recipes and the cell, once the page has it."""

    @property
    def word(self) -> str:
        """Its word in files and on the command line."""
        return self.name.lower()


@dataclass(frozen=True, slots=True)
class Account:
    """A person with an account, or a plant system."""

    name: str
    role: Role


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    role: Literal["plant", "viewer", "operator", "engineer"]
    salt: str
    hash: str
    cost: int = Field(ge=2**4, le=2**20)
    passes: int = Field(default=1, ge=1, le=2**6)


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    accounts: dict[str, _Stored] = Field(default_factory=dict, max_length=MAX_ACCOUNT_COUNT)


def accounts_path() -> Path:
    """Return the file of this user's accounts: $XDG_CONFIG_HOME/cellctl/accounts.json."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "cellctl" / "accounts.json"


def require_name(name: str) -> None:
    """Check that an account may have a name.

    Raises
    ------
    AccountsError : it may not
    """
    if not NAME.fullmatch(name):
        raise AccountsError(
            f"`{name}`: a name has letters, digits, `.`, `_` or `-`, 40 at most, and begins "
            "with a letter or digit"
        )


class Accounts:
    """The accounts of a file, read anew whenever somebody logs in.

    Parameters
    ----------
    path : the file; it need not exist
    cost : cost of new hashes
    """

    def __init__(self, path: Path, cost: int = COST) -> None:
        self._path = path
        self._cost = cost

    def names(self) -> Mapping[str, Role]:
        """Return the role of each account.

        Raises
        ------
        AccountsError : others may read or change the file, or it makes no sense
        """
        return {name: Role[one.role.upper()] for name, one in self._read().accounts.items()}

    def mark(self, name: str) -> str:
        """Return a mark that changes with role and password of an account; empty for an unknown.

        Raises
        ------
        AccountsError : others may read or change the file, or it makes no sense
        """
        stored = self._read().accounts.get(name)
        return "" if stored is None else sha256(stored.model_dump_json().encode()).hexdigest()

    def find(self, name: str, password: str) -> Account | None:
        """Return the account of a name if the password is right; slow on purpose.

        Parameters
        ----------
        name, password : as typed

        Raises
        ------
        AccountsError : others may read or change the file, or it makes no sense
        """
        stored = self._read().accounts.get(name)
        if len(password) > MAX_PASSWORD:
            return None
        if stored is None:
            # as slow as for a name that exists, so that the time betrays no name
            _hashed(password, b"\0" * 16, self._cost, PASSES)
            return None
        found = _hashed(password, b64decode(stored.salt), stored.cost, stored.passes)
        if not compare_digest(found, b64decode(stored.hash)):
            return None
        return Account(name, Role[stored.role.upper()])

    def put(self, name: str, role: Role, password: str) -> None:
        """Add an account, or give it another role and password.

        Parameters
        ----------
        name, role : name and role of the account
        password : as typed; only its hash is kept

        Raises
        ------
        AccountsError : name or password cannot be taken, or the file cannot be read or written
        """
        require_name(name)
        if not MIN_PASSWORD <= len(password) <= MAX_PASSWORD:
            raise AccountsError(f"a password has {MIN_PASSWORD} to {MAX_PASSWORD} characters")
        salt = secrets.token_bytes(16)
        digest = _hashed(password, salt, self._cost, PASSES)
        found = dict(self._read().accounts)
        if name not in found and len(found) >= MAX_ACCOUNT_COUNT:
            raise AccountsError(f"there are {MAX_ACCOUNT_COUNT} accounts, more are not kept")
        found[name] = _Stored.model_validate(
            {
                "role": role.word,
                "salt": b64encode(salt).decode(),
                "hash": b64encode(digest).decode(),
                "cost": self._cost,
                "passes": PASSES,
            }
        )
        self._write(_File(accounts=found))

    def remove(self, name: str) -> None:
        """Remove an account.

        Raises
        ------
        AccountsError : there is none of that name, or the file cannot be read or written
        """
        found = dict(self._read().accounts)
        if found.pop(name, None) is None:
            raise AccountsError(f"no account `{name}`; there are: {', '.join(found) or 'none'}")
        self._write(_File(accounts=found))

    def _read(self) -> _File:
        try:
            found = read_private(self._path)
            return _File() if found is None else _File.model_validate_json(found)
        except SharedFileError as error:
            raise AccountsError(str(error)) from error
        except OSError as error:
            raise AccountsError(f"{self._path}: {error.strerror}") from error
        except ValidationError as error:
            raise AccountsError(
                f"{self._path}: not a file of accounts; move it away and add them anew"
            ) from error

    def _write(self, content: _File) -> None:
        text = json.dumps(content.model_dump(), indent=1) + "\n"
        try:
            write_private(self._path, text)
        except OSError as error:
            raise AccountsError(f"{self._path}: {error.strerror}") from error


def _hashed(password: str, salt: bytes, cost: int, passes: int) -> bytes:
    return scrypt(
        password.encode(),
        salt=salt,
        n=cost,
        r=BLOCK,
        p=passes,
        maxmem=128 * BLOCK * (cost + passes) + SPARE_BYTES,
        dklen=32,
    )
