"""Address by which browsers find the page, and the values that follow from it."""

import ipaddress
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

LOOPBACK_NAMES: Final = ("localhost",)


@dataclass(frozen=True, slots=True)
class PageAddress:
    """Where browsers find the page.

    Attributes
    ----------
    origins : scheme, host and port, as a browser has them in `Origin`
    is_secure : all of them are https
    is_behind : a reverse proxy stands before it, which names the browser's address
    """

    origins: frozenset[str]
    is_secure: bool
    is_behind: bool = False

    @property
    def hosts(self) -> frozenset[str]:
        """Allowed values of `Host`."""
        return frozenset(origin.partition("://")[2] for origin in self.origins)

    @property
    def cookie(self) -> str:
        """Name of the session's cookie; its prefix binds it to this host and to https."""
        return "__Host-cellctl" if self.is_secure else "cellctl"

    @classmethod
    def served(
        cls, host: str, port: int, *, with_tls: bool, names: tuple[str, ...] = ()
    ) -> "PageAddress":
        """Return the site of a server that browsers reach directly.

        Parameters
        ----------
        host, port : address of the server
        with_tls : True if it speaks https
        names : further names of the server
        """
        scheme = "https" if with_tls else "http"
        every = {host, *names, *(("127.0.0.1", *LOOPBACK_NAMES) if is_loopback(host) else ())}
        default = 443 if with_tls else 80
        shown = {f"[{name}]" if ":" in name else name for name in every}
        origins = {f"{scheme}://{name}:{port}" for name in shown}
        if port == default:
            origins |= {f"{scheme}://{name}" for name in shown}
        return cls(frozenset(origins), with_tls)

    @classmethod
    def behind(cls, origin: str) -> "PageAddress":
        """Return the site of a reverse proxy.

        Raises
        ------
        ValueError : the origin is not like https://cell.example
        """
        parts = urlsplit(origin)
        is_plain = parts.path in ("", "/") and not (parts.query or parts.fragment or parts.username)
        if parts.scheme != "https" or not parts.hostname or not is_plain:
            raise ValueError(f"`{origin}` is not like https://cell.example")
        return cls(frozenset({f"https://{parts.netloc.lower()}"}), True, is_behind=True)


def is_loopback(host: str) -> bool:
    """Return whether an address is of this machine alone."""
    if host in LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
