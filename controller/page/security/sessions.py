"""Sessions of browsers, in memory alone, and how often somebody may try to log in."""

import secrets
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256
from hmac import compare_digest
from typing import Final

from .accounts import Account

IDLE_MAX_WALL_S: Final = 12 * 3600.0
AGE_MAX_WALL_S: Final = 24 * 3600.0
SESSION_MAX_COUNT: Final = 500
LINK_MAX_WALL_S: Final = 600.0

# Log-ins that may fail, from one address and from all together, within a time.
ATTEMPT_MAX_COUNT: Final = 5
ATTEMPT_ALL_MAX_COUNT: Final = 60
ATTEMPT_WALL_S: Final = 300.0
ADDRESS_MAX_COUNT: Final = 10_000


@dataclass(slots=True)
class Session:
    """A browser that is logged in.

    Attributes
    ----------
    account : whose it is
    csrf : what each of its orders must carry
    began_s, used_s : on the clock of the sessions
    """

    account: Account
    csrf: str
    began_s: float
    used_s: float


class Sessions:
    """The sessions of one server; they end with it.

    Parameters
    ----------
    clock : seconds that only go forward
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._by_digest: OrderedDict[str, Session] = OrderedDict()
        self._links: dict[str, tuple[Account, float]] = {}

    def begin(self, account: Account) -> str:
        """Return the secret of a new session."""
        secret = secrets.token_urlsafe(32)
        now_s = self._clock()
        self._by_digest[_digest(secret)] = Session(account, secrets.token_urlsafe(32), now_s, now_s)
        while len(self._by_digest) > SESSION_MAX_COUNT:
            self._by_digest.popitem(last=False)
        return secret

    def find(self, secret: str) -> Session | None:
        """Return the session of a secret, None if it has ended or never was."""
        digest = _digest(secret)
        found = self._by_digest.get(digest)
        if found is None:
            return None
        now_s = self._clock()
        if now_s - found.used_s > IDLE_MAX_WALL_S or now_s - found.began_s > AGE_MAX_WALL_S:
            del self._by_digest[digest]
            return None
        found.used_s = now_s
        return found

    def end(self, secret: str) -> None:
        """End a session."""
        self._by_digest.pop(_digest(secret), None)

    def end_of(self, name: str) -> None:
        """End all sessions of an account."""
        for digest in [d for d, one in self._by_digest.items() if one.account.name == name]:
            del self._by_digest[digest]

    def link(self, account: Account) -> str:
        """Return a token that begins one session of an account, once, for some minutes."""
        token = secrets.token_urlsafe(32)
        self._links[_digest(token)] = (account, self._clock() + LINK_MAX_WALL_S)
        return token

    def redeem(self, token: str) -> Account | None:
        """Return the account of a token, which is spent by that; None if it is none."""
        account, until_s = self._links.pop(_digest(token), (None, 0.0))
        return account if self._clock() <= until_s else None


@dataclass(slots=True)
class Attempts:
    """Log-ins that failed lately; who fails too often has to wait.

    Attributes
    ----------
    clock : seconds that only go forward
    """

    clock: Callable[[], float] = time.monotonic
    _by_address: OrderedDict[str, deque[float]] = field(default_factory=OrderedDict)
    _all: deque[float] = field(default_factory=deque)

    def seconds_to_wait(self, address: str) -> float:
        """Return after how many seconds an address may try again, 0 for now [wall s]."""
        now_s = self.clock()
        own = self._by_address.get(address, deque())
        return max(
            _wait(own, ATTEMPT_MAX_COUNT, now_s), _wait(self._all, ATTEMPT_ALL_MAX_COUNT, now_s)
        )

    def note(self, address: str) -> None:
        """Note an attempt, before it is known whether it fails."""
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


def _digest(secret: str) -> str:
    return sha256(secret.encode()).hexdigest()
