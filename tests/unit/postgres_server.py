"""A PostgreSQL server of a test's own, on a socket in a temporary folder, as no superuser."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

USERS = ("postgres", "nobody")  # the server refuses to be started by root


def missing() -> str:
    """Return why there is no server to be had; empty if there is one."""
    if _programs() is None:
        return "no initdb and postgres here (Debian: apt-get install postgresql)"
    return (
        "" if os.getuid() or _user() else "root may not start postgres, and there is no other user"
    )


def _programs() -> Path | None:
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    found = shutil.which("initdb")
    for folder in (*folders, *([Path(found).parent] if found else [])):
        if all(os.access(folder / name, os.X_OK) for name in ("initdb", "pg_ctl", "postgres")):
            return folder
    return None


def _user() -> str | None:
    known = {one.pw_name for one in pwd.getpwall()}
    return next((name for name in USERS if name in known), None)


@contextmanager
def server() -> Iterator[str]:
    """Start a server and give the URL of its database."""
    programs = _programs()
    assert programs is not None
    folder = Path(tempfile.mkdtemp(prefix="pg"))  # a socket's path has to be short
    more: dict[str, object] = {"cwd": folder, "check": True, "capture_output": True, "timeout": 120}
    if not os.getuid():
        user = pwd.getpwnam(_user() or "")
        os.chown(folder, user.pw_uid, user.pw_gid)
        more |= {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
    data = folder / "data"
    start = [programs / "pg_ctl", "-D", data, "-w", "-l", folder / "log"]
    options = f"-k {folder} -c listen_addresses= -c fsync=off"
    try:
        subprocess.run([programs / "initdb", "-D", data, "-U", "cell", "-A", "trust"], **more)
        subprocess.run([*start, "-o", options, "start"], **more)
        try:
            yield f"postgresql+pg8000://cell@/postgres?unix_sock={folder}/.s.PGSQL.5432"
        finally:
            subprocess.run([programs / "pg_ctl", "-D", data, "-m", "immediate", "stop"], **more)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
