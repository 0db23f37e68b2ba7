"""A PostgreSQL server of a test's own, on a socket in a temporary folder, as no superuser."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
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


@dataclass(slots=True)
class Wire:
    """A wire to a server, and how often its client waited for an answer."""

    url: str
    round_trips: int = 0


@contextmanager
def counted(url: str) -> Iterator[Wire]:
    """Give a wire to a server that counts the round trips of one client at a time."""
    there = url.rpartition("=")[2]
    folder = Path(tempfile.mkdtemp(prefix="pgwire"))
    wire = Wire(f"{url.rpartition('=')[0]}={folder}/s")
    door = socket.socket(socket.AF_UNIX)
    door.bind(f"{folder}/s")
    door.listen()
    threads = [threading.Thread(target=_enter, args=(door, there, wire), daemon=True)]
    threads[0].start()
    try:
        yield wire
    finally:
        with suppress(OSError):
            door.shutdown(socket.SHUT_RDWR)
        door.close()
        threads[0].join(10)
        shutil.rmtree(folder, ignore_errors=True)


def _enter(door: socket.socket, there: str, wire: Wire) -> None:
    """Carry bytes both ways for each client, until the door is closed."""
    while True:
        try:
            client, _ = door.accept()
        except OSError:
            return
        server = socket.socket(socket.AF_UNIX)
        server.connect(there)
        is_asked = threading.Event()
        ways = ((client, server, True), (server, client, False))
        for source, sink, is_asking in ways:
            args = (source, sink, wire, is_asked, is_asking)
            threading.Thread(target=_carry, args=args, daemon=True).start()


def _carry(
    source: socket.socket,
    sink: socket.socket,
    wire: Wire,
    is_asked: threading.Event,
    is_asking: bool,
) -> None:
    with suppress(OSError):
        while data := source.recv(1 << 16):
            if is_asking:
                is_asked.set()
            elif is_asked.is_set():
                is_asked.clear()
                wire.round_trips += 1
            sink.sendall(data)
    for one in (source, sink):
        with suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)
        one.close()
