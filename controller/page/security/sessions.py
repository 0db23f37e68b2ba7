"""Sessions of browsers, which outlive the page, and limits on failed log-ins."""

import json
import logging
import os
import secrets
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256
from hmac import compare_digest
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .accounts import Account, Accounts, AccountsError, Role
from .private_file import SharedFileError, read_private, write_private

log = logging.getLogger(__name__)

IDLE_MAX_WALL_S: Final = 12 * 3600.0
AGE_MAX_WALL_S: Final = 24 * 3600.0
SESSION_MAX_COUNT: Final = 500
LINK_MAX_WALL_S: Final = 600.0
# Age of the time of a session's last use in its file: the page would end the session this much
# sooner.
KEPT_WALL_S: Final = 600.0
UNREAD: Final = "unread"  # no account has this mark

# Log-ins that may fail within a time, from one address and from all together.
ATTEMPT_MAX_COUNT: Final = 5
ATTEMPT_ALL_MAX_COUNT: Final = 60
ATTEMPT_WALL_S: Final = 300.0
ADDRESS_MAX_COUNT: Final = 10_000


@dataclass(slots=True)
class BrowserSession:
    """A logged-in browser.

    Attributes
    ----------
    account : account of the session
    csrf : token that each of its orders must carry
    began_s, used_s : on the clock of the sessions
    mark : `Accounts.mark` of the account when it began
    """

    account: Account
    csrf: str
    began_s: float
    used_s: float
    mark: str = ""


class _Kept(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    digest: str = Field(pattern="^[0-9a-f]{64}$")
    name: str
    role: int = Field(ge=Role.VIEWER, le=max(Role))
    began_s: float
    used_s: float
    mark: str


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    sessions: tuple[_Kept, ...] = ()


def sessions_path(origin: str) -> Path:
    """Return the file of a page's sessions, in $XDG_STATE_HOME/cellctl.

    Parameters
    ----------
    origin : address of the page; a page of another address has sessions of its own
    """
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "cellctl" / f"sessions-{_digest(origin)[:16]}.json"


class Sessions:
    """The sessions of a page; with a file they go on when the page is started again.

    The file has a digest of each secret, from which the secret cannot be recovered; the token of
    the orders follows from the secret. A session whose account has changed meanwhile is not
    resumed.

    Parameters
    ----------
    clock : UTC, seconds since 1970
    path : the file, None for sessions that end with the server
    accounts : accounts that may log in
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.time,
        path: Path | None = None,
        accounts: Accounts | None = None,
    ) -> None:
        self._clock = clock
        self._path = path
        self._accounts = accounts
        self._kept_s = clock()
        self._by_digest = self._read()
        self._links: dict[str, tuple[Account, float]] = {}

    def begin(self, account: Account) -> str:
        """Return the secret of a new session."""
        secret = secrets.token_urlsafe(32)
        now_s = self._clock()
        try:
            mark = self._mark(account.name)
        except AccountsError:  # whoever comes by the link is let in; the session ends with the page
            mark = UNREAD
        self._by_digest[_digest(secret)] = BrowserSession(
            account, _csrf(secret), now_s, now_s, mark
        )
        while len(self._by_digest) > SESSION_MAX_COUNT:
            self._by_digest.popitem(last=False)
        self._keep()
        return secret

    def find(self, secret: str) -> BrowserSession | None:
        """Return the session of a secret, None if it has ended or never was."""
        digest = _digest(secret)
        found = self._by_digest.get(digest)
        if found is None:
            return None
        now_s = self._clock()
        if _is_over(found, now_s):
            del self._by_digest[digest]
            return None
        found.used_s, found.csrf = now_s, _csrf(secret)
        if now_s - self._kept_s > KEPT_WALL_S:
            self._keep()
        return found

    def end(self, secret: str) -> None:
        """End a session."""
        if self._by_digest.pop(_digest(secret), None) is not None:
            self._keep()

    def link(self, account: Account) -> str:
        """Return a token that begins one session of an account, once, for some minutes."""
        token = secrets.token_urlsafe(32)
        self._links[_digest(token)] = (account, self._clock() + LINK_MAX_WALL_S)
        return token

    def redeem(self, token: str) -> Account | None:
        """Return the account of a token, which is then used up; None if it is invalid."""
        account, until_s = self._links.pop(_digest(token), (None, 0.0))
        return account if self._clock() <= until_s else None

    def _mark(self, name: str) -> str:
        return "" if self._accounts is None else self._accounts.mark(name)

    def _read(self) -> OrderedDict[str, BrowserSession]:
        """Return the valid sessions of the file; none where it cannot be trusted."""
        found: OrderedDict[str, BrowserSession] = OrderedDict()
        if self._path is None:
            return found
        now_s = self._clock()
        try:
            content = read_private(self._path)
            file = _File() if content is None else _File.model_validate_json(content)
            for one in file.sessions[-SESSION_MAX_COUNT:]:
                account = Account(one.name, Role(one.role))
                session = BrowserSession(account, "", one.began_s, one.used_s, one.mark)
                if not _is_over(session, now_s) and self._mark(one.name) == one.mark:
                    found[one.digest] = session
        except (OSError, SharedFileError, AccountsError, ValidationError) as error:
            log.warning("everybody has to log in again: %s: %s", self._path, error)
            found.clear()
        return found

    def _keep(self) -> None:
        """Write the file; sessions that could not be kept end with the server."""
        self._kept_s = self._clock()
        if self._path is None:
            return
        sessions = [
            {
                "digest": digest,
                "name": one.account.name,
                "role": int(one.account.role),
                "began_s": one.began_s,
                "used_s": one.used_s,
                "mark": one.mark,
            }
            for digest, one in self._by_digest.items()
        ]
        try:
            write_private(self._path, json.dumps({"sessions": sessions}, indent=1) + "\n")
        except OSError as error:
            log.warning("sessions end with the page: %s: %s", self._path, error.strerror)


@dataclass(slots=True)
class Attempts:
    """Recent failed log-ins; too many of them impose a wait.

    Attributes
    ----------
    clock : seconds that only go forward
    """

    clock: Callable[[], float] = time.monotonic
    _by_address: OrderedDict[str, deque[float]] = field(default_factory=OrderedDict)
    _all: deque[float] = field(default_factory=deque)

    def seconds_to_wait(self, address: str) -> float:
        """Return the seconds until an address may try again, 0 for now [wall s]."""
        now_s = self.clock()
        own = self._by_address.get(address, deque())
        return max(
            _wait(own, ATTEMPT_MAX_COUNT, now_s), _wait(self._all, ATTEMPT_ALL_MAX_COUNT, now_s)
        )

    def note(self, address: str) -> None:
        """Count an attempt before its result is known."""
        now_s = self.clock()
        self._by_address.setdefault(address, deque(maxlen=ATTEMPT_MAX_COUNT)).append(now_s)
        self._by_address.move_to_end(address)
        while len(self._by_address) > ADDRESS_MAX_COUNT:
            self._by_address.popitem(last=False)
        self._all.append(now_s)
        while len(self._all) > ATTEMPT_ALL_MAX_COUNT:
            self._all.popleft()

    def forgive(self, address: str) -> None:
        """Forget the attempts of an address that has logged in."""
        for when_s in self._by_address.pop(address, deque()):
            if when_s in self._all:
                self._all.remove(when_s)


def _wait(attempts: deque[float], most: int, now_s: float) -> float:
    recent = [t for t in attempts if now_s - t < ATTEMPT_WALL_S]
    return recent[-most] + ATTEMPT_WALL_S - now_s if len(recent) >= most else 0.0


def same(a: str, b: str) -> bool:
    """Return whether two secrets are the same, in a time that betrays nothing."""
    return compare_digest(a.encode(), b.encode())


def _is_over(session: BrowserSession, now_s: float) -> bool:
    """Return whether a session is too old, or idle for too long, or of a time to come."""
    idle_s, age_s = now_s - session.used_s, now_s - session.began_s
    return abs(idle_s) > IDLE_MAX_WALL_S or abs(age_s) > AGE_MAX_WALL_S


def _digest(secret: str) -> str:
    return sha256(secret.encode()).hexdigest()


def _csrf(secret: str) -> str:
    """Return the token of a session's orders, from which the secret cannot be recovered."""
    return sha256(b"token of orders " + secret.encode()).hexdigest()
