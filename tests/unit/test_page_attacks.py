"""Attacks on the page, one a line: none gets through, changes a session, or reaches a cell.

`test_page_routes.py` tries every address without log-in, with a lesser role, from another page and
without the token; `test_page_security.py` has limits and times. Here is the list by name.
"""

from __future__ import annotations

import asyncio
import json
import socket
import zipfile
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import ORIGIN, PASSWORD, RUN, Bench, bench, journal, picture
from test_page_security import served

from controller.cell.control import DecisionReply, Order, RunningCell
from controller.cell.journal import rows
from controller.launching import Launcher
from controller.page.frame import Upload
from controller.page.http import CONNECTION_MAX_COUNT, CONNECTION_OF_ONE_MAX_COUNT
from controller.page.now.live import (
    WATCHER_OF_ADDRESS_MAX_COUNT,
    WATCHER_OF_ONE_MAX_COUNT,
    Live,
    TooManyWatchersError,
)
from controller.page.security import Role
from controller.page.security.sessions import ATTEMPT_MAX_COUNT

SCRIPT = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"
JSON = "application/json"


class Victim:
    """A page with an engineer logged in, before a run whose papers are hostile."""

    def __init__(self, at: Bench) -> None:
        self.at = at
        self.csrf = at.log_in(Role.ENGINEER)
        self.headers = {"Origin": ORIGIN, "X-CSRF-Token": self.csrf}

    def get(self, path: str, **headers: str) -> int:
        return self.at.client.get(path, headers=headers).status_code

    def post(self, path: str, body: object = None, **headers: str) -> int:
        content = body if isinstance(body, bytes) else json.dumps(body or {}).encode()
        sent = {"Content-Type": JSON, **self.headers, **headers}
        sent = {name: value for name, value in sent.items() if value != "-"}
        return self.at.client.post(path, content=content, headers=sent).status_code

    def upload(self, name: str, content: bytes, **headers: str) -> int:
        """Send a file to every address that takes one; return the mildest answer."""
        return min(
            self.at.client.post(
                screen.address(one.path),
                params={"name": name},
                content=content,
                headers={**self.headers, **headers},
            ).status_code
            for screen in self.at.page.screens
            for one in screen.answers
            if isinstance(one, Upload)
        )

    def log_out(self) -> None:
        self.at.client.cookies.clear()

    def log_in(self, name: str, password: str, **headers: str) -> Any:
        return self.at.client.post(
            "/login",
            data={"name": name, "password": password},
            headers={"Origin": ORIGIN, **headers},
        )


@pytest.fixture
def victim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    reached: list[object] = []

    def order(_: RunningCell, name: str, body: Order) -> DecisionReply:
        reached.append((name, body))
        return DecisionReply(decision="handled", state="idle")

    async def start(_: Launcher, *more: object) -> None:
        reached.append(more)

    monkeypatch.setattr(RunningCell, "order", order)
    monkeypatch.setattr(Launcher, "start", start)
    runs = tmp_path / "runs"
    writer = journal(runs, with_cell=False)
    picture(runs, "pictures/a.png")
    picture(runs, "secret.png", "another-run")
    (runs / RUN / "link.png").symlink_to(runs / "another-run" / "secret.png")
    (runs / RUN / "script.png").write_bytes(SCRIPT.encode())
    names = ("../another-run/secret.png", "/etc/passwd", "link.png", "script.png")
    writer.write(rows.TablePictures({f"lamp {k}": name for k, name in enumerate(names)}), 1)
    writer.close()
    at = bench(tmp_path)
    at.page.accounts.put("ada", Role.ENGINEER, PASSWORD)
    at.read()
    found = Victim(at)
    yield found
    assert reached == []  # whatever was tried, nothing reached the cell and nothing was started


def anonymous(at: Victim) -> int:
    at.log_out()
    return at.post("/now/act/stop")


def lesser_role(at: Victim) -> int:
    at.log_out()
    at.headers["X-CSRF-Token"] = at.at.log_in(Role.VIEWER)
    return at.post("/now/start", {"recipes": [{"recipe": "holder"}]})


def operator_as_engineer(at: Victim) -> int:
    at.log_out()
    at.headers["X-CSRF-Token"] = at.at.log_in(Role.OPERATOR)
    return at.upload("part.stl", b"solid")


def fixed_session(at: Victim) -> int:
    at.log_out()
    at.at.client.cookies.set("cellctl", "chosen-by-the-attacker", domain="127.0.0.1")
    at.at.log_in(Role.OPERATOR)
    at.log_out()
    return at.get("/session", Cookie="cellctl=chosen-by-the-attacker")


def old_session_after_log_in(at: Victim) -> int:
    before = at.at.client.cookies["cellctl"]
    at.at.log_in(Role.OPERATOR)
    at.log_out()
    return at.get("/session", Cookie=f"cellctl={before}")


def stolen_cookie_after_log_out(at: Victim) -> int:
    stolen = at.at.client.cookies["cellctl"]
    assert at.post("/logout") == 200
    at.log_out()
    return at.get("/session", Cookie=f"cellctl={stolen}")


def link_twice(at: Victim) -> int:
    from controller.page.security import Account

    token = at.at.page.sessions.link(Account("eve", Role.ENGINEER))
    assert at.get(f"/enter?token={token}") == 303
    at.log_out()
    return at.get(f"/enter?token={token}")


def brute_force(at: Victim) -> int:
    for number in range(ATTEMPT_MAX_COUNT):
        at.log_in("ada", f"guess {number}")
    return int(at.log_in("ada", PASSWORD).status_code)


def brute_force_from_named_addresses(at: Victim) -> int:
    for number in range(ATTEMPT_MAX_COUNT):
        at.log_in("ada", "guess", **{"X-Forwarded-For": f"10.0.0.{number}"})
    return int(at.log_in("ada", PASSWORD, **{"X-Forwarded-For": "10.9.9.9"}).status_code)


def foreign_log_in(at: Victim) -> int:
    return int(at.log_in("ada", PASSWORD, Origin="http://evil.example").status_code)


def bomb(at: Victim, name: str, entry: str) -> int:
    path = at.at.page.accounts._path.with_name("bomb.zip")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(entry, b"0" * 30_000_000)
    return at.upload(name, path.read_bytes())


def with_parameter(path: str, value: str) -> Callable[[Victim], int]:
    return lambda at: at.get(path, Cookie=f"cellctl={value}")


def injected_header(at: Victim) -> int:
    reply = at.at.client.get("/now?lang=de%0d%0aSet-Cookie:%20x=1")
    assert "x=1" not in reply.headers.get("set-cookie", "")
    assert at.at.client.get("/login?lang=de%0d%0aX: y").headers.get("x") is None
    return 400


def redirected_elsewhere(at: Victim) -> int:
    at.log_out()
    for path in ("//evil.example", "/login?next=http://evil.example", "/?next=//evil.example"):
        reply = at.at.client.get(path)
        assert "evil" not in reply.headers.get("location", "")
    return 400


def reflected_template(at: Victim) -> int:
    text = at.log_in("{{ 7 * 7 }}${7*7}", "x").text
    assert "49" not in text.split("<form")[1].split("</form>")[0]
    return 400


def script_in_names(at: Victim) -> int:
    at.log_out()
    at.at.log_in(Role.OPERATOR, SCRIPT)
    for path in ("/now", "/login"):
        assert "<script>alert" not in at.at.client.get(path).text
        assert "<img" not in at.at.client.get(path).text
    assert "<script>alert" not in at.log_in(SCRIPT, "x").text
    return 400


def streams_by_one(at: Victim) -> int:
    live = Live(at.at.live._runs_dir)
    live.publish()

    async def exhaust() -> int:
        streams = [live.watch("eve") for _ in range(WATCHER_OF_ONE_MAX_COUNT)]
        for stream in streams:
            await anext(stream)
        refused = 0
        try:
            await anext(live.watch("eve"))
        except TooManyWatchersError:
            refused = 503
        other = live.watch("ada")
        assert (await anext(other))[0] == "now"  # others still look
        for stream in (*streams, other):
            await stream.aclose()  # type: ignore[attr-defined]
        return refused

    return asyncio.run(exhaust())


def streams_by_one_address(at: Victim) -> int:
    live = Live(at.at.live._runs_dir)
    live.publish()

    async def exhaust() -> int:
        streams = [
            live.watch(f"eve {number}", "10.0.0.1")
            for number in range(WATCHER_OF_ADDRESS_MAX_COUNT)
        ]
        for stream in streams:
            await anext(stream)
        with pytest.raises(TooManyWatchersError):
            await anext(live.watch("eve", "10.0.0.1"))
        other = live.watch("ada", "10.0.0.2")
        assert (await anext(other))[0] == "now"  # others still look
        for stream in (*streams, other):
            await stream.aclose()  # type: ignore[attr-defined]
        return 503

    return asyncio.run(exhaust())


START = {"recipes": [{"recipe": "holder"}]}
ATTACKS: dict[str, Callable[[Victim], int]] = {
    "an order without a log-in": anonymous,
    "a start by a viewer": lesser_role,
    "a file sent by an operator": operator_as_engineer,
    "an invented session": with_parameter("/session", "x" * 43),
    "an empty session": with_parameter("/session", ""),
    "a session chosen beforehand": fixed_session,
    "the session of before a log-in": old_session_after_log_in,
    "a cookie stolen before a log-out": stolen_cookie_after_log_out,
    "the printed link once more": link_twice,
    "an invented link": lambda at: (at.log_out(), at.get("/enter?token=" + "x" * 43))[1],
    "passwords by the dozen": brute_force,
    "passwords from addresses that are named only": brute_force_from_named_addresses,
    "an endless password": lambda at: at.log_in("ada", "x" * 60_000).status_code,
    "a log-in from another page": foreign_log_in,
    "a forged origin": lambda at: at.post("/now/act/stop", Origin="http://evil.example"),
    "no origin": lambda at: at.post("/now/act/stop", Origin="-"),
    "the origin of a file": lambda at: at.post("/now/act/stop", Origin="null"),
    "another port of this machine": lambda at: at.post(
        "/now/act/stop", Origin="http://127.0.0.1:8471"
    ),
    "no token of the session": lambda at: at.post("/now/act/stop", **{"X-CSRF-Token": "-"}),
    "a token in the address": lambda at: at.post(
        f"/now/act/stop?csrf={at.csrf}", **{"X-CSRF-Token": "-"}
    ),
    "an order as a form": lambda at: at.post(
        "/now/act/stop", b"{}", **{"Content-Type": "application/x-www-form-urlencoded"}
    ),
    "an order by fetching": lambda at: at.get("/now/act/stop"),
    "another method by header": lambda at: at.get(
        "/now/act/stop", **{"X-HTTP-Method-Override": "POST"}
    ),
    "another name in the order": lambda at: at.post("/now/act/stop", {"who": "ada"}),
    "another operator in the start": lambda at: at.post("/now/start", {**START, "operator": "x"}),
    "an option of tests in the start": lambda at: at.post(
        "/now/start", {**START, "control": "/tmp/x"}
    ),
    "polluted prototypes": lambda at: at.post("/now/act/stop", {"__proto__": {"role": "x"}}),
    "a rebound host name": lambda at: at.get("/now", Host="evil.example"),
    "a host named by a proxy that is none": lambda at: at.post(
        "/now/act/stop", Origin="http://evil.example", **{"X-Forwarded-Host": "evil.example"}
    ),
    "a picture by a path": lambda at: at.get(f"/now/picture/{RUN}/0"),
    "a picture by an absolute path": lambda at: at.get(f"/now/picture/{RUN}/1"),
    "a picture by a link": lambda at: at.get(f"/now/picture/{RUN}/2"),
    "a script as a picture": lambda at: at.get(f"/now/picture/{RUN}/3"),
    "a picture of another run": lambda at: at.get("/now/picture/another-run/0"),
    "a run with a path": lambda at: at.get("/now/picture/..%2fanother-run/0"),
    "a file beside the page's own": lambda at: at.get("/static/..%2f..%2fapp.py"),
    "a file with a path": lambda at: at.upload("../../.bashrc", b"solid"),
    "a file with a zero byte": lambda at: at.upload("part.stl\x00.py", b"solid"),
    "a list of a foreign file": lambda at: at.upload("a.csv", b"recipe\n../../../etc/passwd\n"),
    "a list of a script": lambda at: at.upload("a.csv", b"recipe\n<script>alert(1)</script>\n"),
    "a list of bytes": lambda at: at.upload("a.csv", bytes(range(256))),
    "a program as a part": lambda at: at.upload("part.py", b"import os"),
    "a file of 10 GB": lambda at: at.upload("a.stl", b"solid", **{"Content-Length": "10000000000"}),
    "a file of negative size": lambda at: at.upload("a.stl", b"", **{"Content-Length": "-1"}),
    "an archive that unpacks to everything": lambda at: bomb(at, "a.3mf", "3D/3dmodel.model"),
    "an archive that calls itself a mesh": lambda at: bomb(at, "a.stl", "3D/3dmodel.model"),
    "JSON of a megabyte": lambda at: at.post("/now/act/stop", b'{"why": "' + b"x" * 1_000_000),
    "JSON a thousand levels deep": lambda at: at.post("/now/act/stop", b"[" * 30_000),
    "a body that is packed": lambda at: at.post(
        "/now/act/stop", b"\x1f\x8b\x08\x00", **{"Content-Encoding": "gzip"}
    ),
    "numbers that are none": lambda at: at.post(
        "/now/start", b'{"recipes":[{"recipe":"holder"}],"speed":NaN}'
    ),
    "a header within a parameter": injected_header,
    "a way to another site": redirected_elsewhere,
    "a template as a name": reflected_template,
    "scripts as names": script_in_names,
    "all streams taken by one": streams_by_one,
    "all streams taken by one address": streams_by_one_address,
    "an address without end": lambda at: at.get("/now/" + "x" * 2_000),
    "cookies without end": lambda at: at.get("/now", Cookie="a=" + "x" * 20_000),
}


def test_there_are_enough_attacks_to_call_it_a_list() -> None:
    assert len(ATTACKS) >= 50


@pytest.mark.parametrize("name", ATTACKS)
def test_no_attack_gets_through(victim: Victim, name: str) -> None:
    assert 400 <= ATTACKS[name](victim) < 600


def test_another_page_gets_no_frame_no_answer_and_no_cookie(victim: Victim) -> None:
    reply = victim.at.client.get("/now")
    assert reply.headers["x-frame-options"] == "DENY"
    assert not [name for name in reply.headers if name.startswith("access-control-")]
    assert reply.headers["cross-origin-resource-policy"] == "same-origin"


WIRE = {
    "two lengths": b"POST /login HTTP/1.1\r\nHost: HERE\r\nContent-Length: 4\r\n"
    b"Content-Length: 40\r\n\r\nabcd",
    "a second request within a body": b"POST /login HTTP/1.1\r\nHost: HERE\r\n"
    b"Transfer-Encoding: chunked\r\nContent-Length: 4\r\n\r\n0\r\n\r\nGET /now HTTP/1.1\r\n\r\n",
    "a websocket": b"GET /now/events HTTP/1.1\r\nHost: HERE\r\nUpgrade: websocket\r\n"
    b"Connection: Upgrade\r\nSec-WebSocket-Key: x\r\nSec-WebSocket-Version: 13\r\n\r\n",
    "a proxy's request": b"CONNECT evil.example:443 HTTP/1.1\r\nHost: evil.example:443\r\n\r\n",
    "another protocol": b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "a header with a zero byte": b"GET /now HTTP/1.1\r\nHost: HERE\r\nX: \x00\r\n\r\n",
}


def test_what_is_wrong_on_the_wire_is_refused_and_the_page_goes_on(tmp_path: Path) -> None:
    with served(tmp_path) as port:
        here = f"127.0.0.1:{port}".encode()
        for name, sent in WIRE.items():
            with socket.create_connection(("127.0.0.1", port), timeout=600.0) as wire:
                wire.sendall(sent.replace(b"HERE", here))
                wire.shutdown(socket.SHUT_WR)
                answer = wire.recv(65_536)
            assert answer == b"" or answer.split(b" ")[1][:1] in (b"4", b"5"), name
        with socket.create_connection(("127.0.0.1", port), timeout=600.0) as wire:
            wire.sendall(b"GET /login HTTP/1.1\r\nHost: " + here + b"\r\n\r\n")
            assert b" 200 " in wire.recv(65_536)


@pytest.mark.parametrize("is_idle", [True, False])
def test_one_address_cannot_take_all_connections(tmp_path: Path, is_idle: bool) -> None:
    with served(tmp_path) as port, ExitStack() as held:
        here = f"127.0.0.1:{port}"
        look = f"GET /login HTTP/1.1\r\nHost: {here}\r\nConnection: close\r\n\r\n".encode()
        body = f"Origin: http://{here}\r\nContent-Length: 100\r\n\r\nname=".encode()
        begun = b"" if is_idle else f"POST /login HTTP/1.1\r\nHost: {here}\r\n".encode() + body

        def connected(address: str) -> socket.socket:
            return held.enter_context(
                socket.create_connection(("127.0.0.1", port), 600.0, source_address=(address, 0))
            )

        hostile = []
        for _ in range(CONNECTION_MAX_COUNT + 20):
            hostile.append(connected("127.0.0.2"))
            with suppress(OSError):
                hostile[-1].sendall(begun)
        for address in ("127.0.0.1", "127.0.0.2") if is_idle else ("127.0.0.1",):
            wire = connected(address)
            wire.sendall(look)
            assert b" 200 " in wire.recv(65_536), address
        kept = 0
        for wire in hostile:
            wire.setblocking(False)
            try:
                wire.recv(1)
            except BlockingIOError:
                kept += 1
            except OSError:  # given up
                pass
        assert kept <= CONNECTION_OF_ONE_MAX_COUNT
