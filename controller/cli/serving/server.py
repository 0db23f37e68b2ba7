"""Serves the page, if its packages are installed and the address is allowed."""

import getpass
import socket
from importlib.util import find_spec
from pathlib import Path

from controller.config import ConfigError

from ..terminal.output import emit, print_line
from .arguments import ServeOptions

PACKAGES = ("starlette", "uvicorn")


def serve_page(options: ServeOptions) -> int:
    """Serve the page until a signal ends it; return 0.

    Raises
    ------
    ConfigError : the packages are missing, the address is not allowed or taken, or a file is wrong
    """
    runs_dir, project_dir = options.runs_dir, options.project_dir or Path.cwd()
    host, port, behind = options.host, options.port, options.behind
    cert, key = options.tls_cert, options.tls_key
    proxies, names = tuple(options.proxies or ()), tuple(options.names or ())
    require_packages()
    if not project_dir.is_dir():
        raise ConfigError(f"--recipes {project_dir}: there is no such folder")
    from controller.page.http import Serving
    from controller.page.security import (
        Account,
        Accounts,
        PageAddress,
        Role,
        Sessions,
        accounts_path,
        sessions_path,
    )
    from controller.page.security.addresses import is_loopback
    from controller.page.serving import build, serve

    if (cert is None) != (key is None):
        raise ConfigError("--tls-cert and --tls-key require each other")
    if behind is not None and cert is not None:
        raise ConfigError(
            "--behind: the proxy speaks https, this server does not; leave out --tls-*"
        )
    if proxies and behind is None:
        raise ConfigError("--proxy requires --behind ORIGIN")
    if cert is None and behind is None and not is_loopback(host):
        raise ConfigError(
            f"--host {host}: others could read what is sent; give --tls-cert and --tls-key, or the "
            "origin of a reverse proxy with --behind"
        )
    try:
        site = (
            PageAddress.served(host, port, with_tls=cert is not None, names=names)
            if behind is None
            else PageAddress.behind(behind)
        )
    except ValueError as error:
        raise ConfigError(f"--behind: {error}") from error
    require_free(host, port)
    origin = behind or (
        f"https://{names[0]}:{port}" if cert and names else _origin(host, port, cert)
    )
    accounts = Accounts(accounts_path())
    sessions = Sessions(path=sessions_path(origin), accounts=accounts)
    # who starts the server may do all that it can do anyway
    token = sessions.link(Account(getpass.getuser(), Role.ENGINEER))
    app = build(runs_dir, project_dir, site, accounts, sessions)
    link = f"{origin.rstrip('/')}/enter?token={token}"

    def tell() -> None:
        if options.as_json:
            emit({"event": "ready", "url": origin, "link": link})
            return
        print_line(f"the page of {runs_dir}: {link}")
        print_line("the link logs in once, within 10 minutes; ctrl-c ends the page, not the cell")

    asked_by = (proxies or ("127.0.0.1",)) if behind else ()
    try:
        serve(app, Serving(host, port, cert, key, asked_by), tell)
    except OSError as error:
        raise ConfigError(f"--tls-cert, --tls-key: {error}") from error
    return 0


def require_packages() -> None:
    """Check that the page's packages are installed.

    Raises
    ------
    ConfigError : it is not; the message says how to install it
    """
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise ConfigError(
            f"the page and REST need {' and '.join(missing)}: pip install 'cellctl[page]'"
        )


def require_free(host: str, port: int) -> None:
    """Check that an address can be listened at.

    Raises
    ------
    ConfigError : it is taken, or not of this machine
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind((host, port))
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(f"--host {host} --port {port}: {reason}") from error


def _origin(host: str, port: int, cert: Path | None) -> str:
    shown = f"[{host}]" if ":" in host else host
    return f"{'http' if cert is None else 'https'}://{shown}:{port}"
