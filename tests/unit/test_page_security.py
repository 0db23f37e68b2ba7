"""Attacks on the page: each is refused, changes nothing, and reaches no cell."""

from __future__ import annotations

import json
import socket
import ssl
import threading
import time
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import scrypt
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import ORIGIN, PASSWORD, RUN, Bench, bench, journal, picture

from controller.cell.control import DecisionReply, Order, RunningCell
from controller.cell.journal import rows
from controller.page import http as http_module
from controller.page import serving as serving_module
from controller.page.security import (
    Accounts,
    AccountsError,
    PageAddress,
    Role,
    Sessions,
    accounts_path,
)
from controller.page.security.guard import BODY_MAX_BYTES
from controller.page.security.sessions import (
    AGE_MAX_WALL_S,
    ATTEMPT_ALL_MAX_COUNT,
    ATTEMPT_MAX_COUNT,
    ATTEMPT_WALL_S,
    IDLE_MAX_WALL_S,
    LINK_MAX_WALL_S,
)

ACTS: dict[str, dict[str, Any]] = {
    "pause": {"kind": "now"},
    "resume": {"first": None},
    "stop": {},
    "ack": {"why": "looked"},
    "answer": {"key": "look", "number": 1},
}
LOOKS = ("/now", "/now/events", "/now/scene", "/now/mesh", f"/now/picture/{RUN}/0", "/session")


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Order]]:
    """Orders that reach the cell."""
    found: list[tuple[str, Order]] = []

    def order(_: RunningCell, name: str, body: Order) -> DecisionReply:
        found.append((name, body))
        return DecisionReply(decision="handled", state="suspending_grasping")

    monkeypatch.setattr(RunningCell, "order", order)
    return found


@pytest.fixture
def at(tmp_path: Path) -> Bench:
    writer = journal(tmp_path / "runs", with_cell=False)
    picture(tmp_path / "runs", "pictures/a.png")
    writer.write(rows.TablePictures({"ring": "pictures/a.png"}), 1)
    writer.close()
    found = bench(tmp_path)
    found.read()
    return found


@pytest.mark.parametrize("path", LOOKS)
def test_who_is_not_logged_in_sees_nothing(at: Bench, path: str) -> None:
    reply = at.client.get(path)
    assert reply.status_code in (303, 401)
    assert RUN not in reply.text


@pytest.mark.parametrize("name", ACTS)
def test_who_is_not_logged_in_acts_on_nothing(
    at: Bench, taken: list[tuple[str, Order]], name: str
) -> None:
    assert at.act(name, ACTS[name], "")[0] == 401
    assert taken == []


@pytest.mark.parametrize("name", ACTS)
def test_a_viewer_may_not_act(at: Bench, taken: list[tuple[str, Order]], name: str) -> None:
    csrf = at.log_in(Role.VIEWER)
    assert at.act(name, ACTS[name], csrf)[0] == 403
    assert taken == []
    assert 'id="stop"' not in at.client.get("/now").text


@pytest.mark.parametrize("role", [Role.OPERATOR, Role.ENGINEER])
@pytest.mark.parametrize("name", ACTS)
def test_an_operator_acts_and_the_cell_learns_who(
    at: Bench, taken: list[tuple[str, Order]], name: str, role: Role
) -> None:
    csrf = at.log_in(role, "ada")
    status, text = at.act(name, {**ACTS[name], "why": "a screw"}, csrf)
    assert (status, json.loads(text)["decision"]) == (200, "handled")
    ((order, body),) = taken
    assert (order, body.who, body.why) == (name, "ada, page", "a screw")


@pytest.mark.parametrize("name", ["abort", "step", "recover", "status", "..", "stop/..", ""])
def test_only_the_orders_of_the_page_exist(
    at: Bench, taken: list[tuple[str, Order]], name: str
) -> None:
    assert at.act(name, {}, at.log_in())[0] in (404, 405)
    assert taken == []


@pytest.mark.parametrize(
    "body",
    [
        {"kind": "later"},
        {"kind": "now", "who": "somebody else"},
        {"kind": "now", "why": "x" * 201},
        {"kind": ["now"]},
        {},
        [],
        "now",
    ],
)
def test_an_order_that_makes_no_sense_reaches_no_cell(
    at: Bench, taken: list[tuple[str, Order]], body: object
) -> None:
    assert at.act("pause", body, at.log_in())[0] == 422
    assert taken == []


def test_deep_json_is_refused(at: Bench, taken: list[tuple[str, Order]]) -> None:
    csrf = at.log_in()
    deep = b"[" * 30_000 + b"]" * 30_000
    reply = at.client.post(
        "/now/act/pause",
        content=deep,
        headers={"Origin": ORIGIN, "X-CSRF-Token": csrf, "Content-Type": "application/json"},
    )
    assert reply.status_code == 422
    assert taken == []


@pytest.mark.parametrize("csrf", ["", "x", "x" * 43])
def test_an_order_without_the_token_of_the_page_is_forged(
    at: Bench, taken: list[tuple[str, Order]], csrf: str
) -> None:
    at.log_in()
    assert at.act("stop", {}, csrf)[0] == 403
    assert taken == []


def test_the_token_of_another_session_is_forged(
    at: Bench, taken: list[tuple[str, Order]], tmp_path: Path
) -> None:
    first = at.log_in(name="ada")
    at.client.cookies.clear()
    second = at.log_in(name="bob")
    assert first != second
    assert at.act("stop", {}, first)[0] == 403
    assert taken == []


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1:8470"},
        {"Origin": "http://127.0.0.1:8471"},
        {"Origin": "http://127.0.0.1:8470.evil.example"},
        {"Origin": ""},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_an_order_from_another_page_is_refused(
    at: Bench, taken: list[tuple[str, Order]], headers: dict[str, str]
) -> None:
    assert at.act("stop", {}, at.log_in(), **headers)[0] == 403
    assert taken == []


def test_an_order_without_an_origin_is_refused(at: Bench, taken: list[tuple[str, Order]]) -> None:
    csrf = at.log_in()
    assert (
        at.client.post("/now/act/stop", json={}, headers={"X-CSRF-Token": csrf}).status_code == 403
    )
    assert taken == []


def test_a_form_of_another_page_is_no_order(at: Bench, taken: list[tuple[str, Order]]) -> None:
    csrf = at.log_in()
    status, _ = at.act("stop", {}, csrf, **{"Content-Type": "text/plain"})
    assert status == 415
    assert taken == []


def test_another_page_may_not_read_along(at: Bench) -> None:
    at.log_in()
    reply = at.client.get("/session", headers={"Origin": "http://evil.example"})
    assert reply.status_code == 403
    assert "access-control-allow-origin" not in at.client.get("/session").headers


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8470", "127.0.0.1:8471", "127.0.0.1", "127.0.0.1:8470.evil", ""],
)
def test_a_rebound_name_is_refused(at: Bench, host: str) -> None:
    at.log_in()
    reply = at.client.get("/session", headers={"Host": host})
    assert reply.status_code == 421
    assert "ada" not in reply.text


@pytest.mark.parametrize("host", ["127.0.0.1:8470", "localhost:8470", "LOCALHOST:8470"])
def test_its_own_names_are_served(at: Bench, host: str) -> None:
    assert at.client.get("/login", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT"])
def test_other_methods_do_not_exist(at: Bench, method: str) -> None:
    at.log_in()
    assert at.client.request(method, "/now", headers={"Origin": ORIGIN}).status_code == 405


def test_an_order_is_no_link(at: Bench, taken: list[tuple[str, Order]]) -> None:
    at.log_in()
    assert at.client.get("/now/act/stop").status_code == 405
    assert taken == []


def test_a_large_body_is_refused_before_it_is_read(at: Bench) -> None:
    at.log_in()
    read = 0

    def endless() -> Iterator[bytes]:
        nonlocal read
        while read < 100 * BODY_MAX_BYTES:
            read += 8192
            yield b"x" * 8192

    headers = {"Origin": ORIGIN, "Content-Length": str(10 * 1024**3)}
    assert at.client.post("/now/act/stop", content=b"x", headers=headers).status_code == 413
    reply = at.client.post("/now/act/stop", content=endless(), headers={"Origin": ORIGIN})
    assert reply.status_code == 413


@pytest.mark.parametrize(
    "path",
    [
        "/static/../entering.py",
        "/static/..%2fentering.py",
        "/static/%2e%2e/entering.py",
        "/static//etc/passwd",
        "/static/now/now.js%00.css",
        "/now/picture/..%2f..%2fetc/0",
        f"/now/picture/{RUN}/..%2f..%2fjournal.sqlite",
        f"/now/picture/{RUN}/-1",
        f"/now/picture/{RUN}/99",
        "/now/picture/another-run/0",
    ],
)
def test_a_path_leads_to_no_other_file(at: Bench, path: str) -> None:
    at.log_in()
    assert at.client.get(path).status_code == 404


def test_a_picture_outside_the_run_is_not_handed_out(tmp_path: Path) -> None:
    secret = picture(tmp_path / "runs", "secret.png", "another-run")
    writer = journal(tmp_path / "runs", with_cell=False)
    (tmp_path / "runs" / RUN).mkdir()
    (tmp_path / "runs" / RUN / "link.png").symlink_to(secret)
    names = ("../another-run/secret.png", str(secret), "link.png")
    writer.write(rows.TablePictures({f"lamp {k}": name for k, name in enumerate(names)}), 1)
    writer.close()
    found = bench(tmp_path)
    found.read()
    found.log_in()
    for number in range(len(names)):
        assert found.client.get(f"/now/picture/{RUN}/{number}").status_code == 404


def test_what_is_no_picture_is_not_handed_out(tmp_path: Path) -> None:
    writer = journal(tmp_path / "runs", with_cell=False)
    (tmp_path / "runs" / RUN).mkdir()
    (tmp_path / "runs" / RUN / "bomb.png").write_bytes(b"<script>alert(1)</script>")
    writer.write(rows.TablePictures({"ring": "bomb.png"}), 1)
    writer.close()
    found = bench(tmp_path)
    found.read()
    found.log_in()
    assert found.client.get(f"/now/picture/{RUN}/0").status_code == 404


def test_a_script_in_a_name_stays_text(at: Bench) -> None:
    evil = "</script><script>alert(1)</script>"
    at.log_in(name=evil)
    page = at.client.get("/now")
    assert "alert(1)" in page.text  # it is shown
    assert evil not in page.text
    reply = at.client.post(
        "/login", data={"name": evil, "password": "x"}, headers={"Origin": ORIGIN}
    )
    assert evil not in reply.text


def test_no_answer_lacks_the_headers_that_bind_a_browser(at: Bench) -> None:
    at.log_in()
    paths = (
        "/login",
        "/now",
        "/session",
        "/static/now/now.js",
        "/nothing",
        f"/now/picture/{RUN}/0",
    )
    for path in paths:
        headers = at.client.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
        assert headers["referrer-policy"] == "same-origin"
    assert at.client.get("/nothing", headers={"Host": "x"}).headers["x-frame-options"] == "DENY"


def test_no_page_has_script_or_style_within_itself(at: Bench) -> None:
    at.log_in()
    for path in ("/login", "/now"):
        text = at.client.get(path).text
        for tag in text.split("<script")[1:]:
            assert "src=" in tag.split(">")[0] or 'type="application/json"' in tag.split(">")[0]
        assert "<style" not in text
        assert " style=" not in text
        assert " on" not in "".join(part.split(">")[0] for part in text.split("<button")[1:])


def test_the_cookie_is_for_this_page_alone(at: Bench, tmp_path: Path) -> None:
    token = at.page.sessions.link(at_account("ada"))
    cookie = at.client.get(f"/enter?token={token}").headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert "domain" not in cookie
    behind = bench(tmp_path, PageAddress.behind("https://cell.example"))
    token = behind.page.sessions.link(at_account("ada"))
    reply = behind.client.get(f"/enter?token={token}", headers={"Host": "cell.example"})
    cookie = reply.headers["set-cookie"]
    assert cookie.startswith("__Host-")
    assert "secure" in cookie.lower()
    assert "max-age" in reply.headers["strict-transport-security"]


def at_account(name: str) -> Any:
    from controller.page.security import Account

    return Account(name, Role.OPERATOR)


def test_a_link_logs_in_once_and_not_for_long(at: Bench) -> None:
    token = at.page.sessions.link(at_account("ada"))
    assert at.client.get(f"/enter?token={token}").headers["location"] == "/now"
    at.client.cookies.clear()
    assert at.client.get(f"/enter?token={token}").status_code == 403
    late = at.page.sessions.link(at_account("ada"))
    at.clock.now_s += LINK_MAX_WALL_S + 1
    assert at.client.get(f"/enter?token={late}").status_code == 403
    assert at.client.get("/enter").status_code == 403
    assert at.client.get("/now").status_code == 303


@pytest.mark.parametrize(("steps", "step_s"), [(1, IDLE_MAX_WALL_S + 1), (25, 3600.0)])
def test_a_session_ends_when_idle_and_when_old(at: Bench, steps: int, step_s: float) -> None:
    assert steps == 1 or steps * step_s > AGE_MAX_WALL_S
    at.log_in()
    for _ in range(steps):
        at.clock.now_s += step_s
        reply = at.client.get("/session")
    assert reply.status_code == 401


def test_a_log_out_ends_the_session_on_the_server(at: Bench) -> None:
    csrf = at.log_in()
    cookies = dict(at.client.cookies)
    headers = {"Origin": ORIGIN, "X-CSRF-Token": csrf}
    assert at.client.post("/logout", headers={"Origin": ORIGIN}).status_code == 403
    assert at.client.post("/logout", headers=headers).status_code == 200
    at.client.cookies.update(cookies)  # a copy of the cookie is worth nothing now
    assert at.client.get("/session").status_code == 401


def restarted(at: Bench, folder: Path) -> Sessions:
    """Return the sessions of the page that is started again, after its file was written."""
    return Sessions(at.clock, folder / "sessions.json", at.page.accounts)


def test_a_session_goes_on_when_the_page_is_started_again_and_its_file_has_no_secret(
    at: Bench, tmp_path: Path
) -> None:
    at.page.accounts.put("ada", Role.OPERATOR, PASSWORD)
    before = restarted(at, tmp_path)
    secret = before.begin(at_account("ada"))
    csrf = before.find(secret).csrf  # type: ignore[union-attr]
    written = (tmp_path / "sessions.json").read_text()
    assert secret not in written
    assert csrf not in written
    assert (tmp_path / "sessions.json").stat().st_mode & 0o777 == 0o600
    after = restarted(at, tmp_path).find(secret)
    assert after is not None
    assert (after.account, after.csrf) == (at_account("ada"), csrf)
    before.end(secret)
    assert restarted(at, tmp_path).find(secret) is None


@pytest.mark.parametrize("change", ["role", "password", "removed"])
def test_a_session_of_an_account_that_has_changed_is_not_taken_up_again(
    at: Bench, tmp_path: Path, change: str
) -> None:
    at.page.accounts.put("ada", Role.OPERATOR, PASSWORD)
    before = restarted(at, tmp_path)
    secret, other = before.begin(at_account("ada")), before.begin(at_account("grace"))
    if change == "removed":
        at.page.accounts.remove("ada")
    else:
        role = Role.VIEWER if change == "role" else Role.OPERATOR
        at.page.accounts.put("ada", role, PASSWORD if change == "role" else "another" + PASSWORD)
    after = restarted(at, tmp_path)
    assert after.find(secret) is None
    assert after.find(other) is not None  # by the link, without an account


def test_a_session_grows_old_while_the_page_is_away_and_a_clock_set_back_ends_it(
    at: Bench, tmp_path: Path
) -> None:
    secret = restarted(at, tmp_path).begin(at_account("ada"))
    for step_s in (IDLE_MAX_WALL_S + 1, -AGE_MAX_WALL_S - 1):
        at.clock.now_s += step_s
        assert restarted(at, tmp_path).find(secret) is None
        at.clock.now_s -= step_s
    assert restarted(at, tmp_path).find(secret) is not None


@pytest.mark.parametrize("text", ["{", '{"sessions": [{"digest": "x"}]}', None])
def test_a_file_of_sessions_that_cannot_be_trusted_lets_nobody_in(
    at: Bench, tmp_path: Path, text: str | None
) -> None:
    path = tmp_path / "sessions.json"
    secret = restarted(at, tmp_path).begin(at_account("ada"))
    if text is None:
        path.chmod(0o666)
    else:
        path.write_text(text)
    after = restarted(at, tmp_path)
    assert after.find(secret) is None
    assert after.find(after.begin(at_account("ada"))) is not None


def log_in(at: Bench, name: str, password: str) -> int:
    return at.client.post(
        "/login", data={"name": name, "password": password}, headers={"Origin": ORIGIN}
    ).status_code


def test_a_right_password_logs_in_and_a_wrong_one_does_not(at: Bench) -> None:
    at.page.accounts.put("ada", Role.VIEWER, PASSWORD)
    assert log_in(at, "ada", PASSWORD[:-1]) == 403
    assert log_in(at, "ADA", PASSWORD) == 403
    assert log_in(at, "ada", "") == 403
    assert log_in(at, "ada", PASSWORD) == 303
    assert at.client.get("/session").json() == {"name": "ada", "role": "viewer"}


def test_the_page_is_closed_to_a_plant_system(at: Bench) -> None:
    at.page.accounts.put("mes", Role.PLANT, PASSWORD)
    assert log_in(at, "mes", PASSWORD) == 403
    assert at.client.get("/now", follow_redirects=False).status_code == 303


def test_a_log_in_from_another_page_is_refused(at: Bench) -> None:
    at.page.accounts.put("ada", Role.VIEWER, PASSWORD)
    reply = at.client.post(
        "/login",
        data={"name": "ada", "password": PASSWORD},
        headers={"Origin": "http://evil.example"},
    )
    assert reply.status_code == 403
    assert "set-cookie" not in reply.headers


def test_who_guesses_has_to_wait_even_with_the_right_password(at: Bench) -> None:
    at.page.accounts.put("ada", Role.VIEWER, PASSWORD)
    for _ in range(ATTEMPT_MAX_COUNT):
        assert log_in(at, "ada", "wrong") == 403
    assert log_in(at, "ada", PASSWORD) == 429
    at.clock.now_s += ATTEMPT_WALL_S + 1
    assert log_in(at, "ada", PASSWORD) == 303


def test_many_who_guess_together_have_to_wait(at: Bench) -> None:
    for number in range(ATTEMPT_ALL_MAX_COUNT):
        at.page.attempts.note(f"10.0.0.{number}")
    assert log_in(at, "ada", "wrong") == 429


def test_others_may_not_read_or_change_the_accounts(tmp_path: Path) -> None:
    path = tmp_path / "accounts.json"
    accounts = Accounts(path, 2**4)
    accounts.put("ada", Role.ENGINEER, PASSWORD)
    assert path.stat().st_mode & 0o777 == 0o600
    assert PASSWORD not in path.read_text()
    path.chmod(0o644)
    with pytest.raises(AccountsError, match="chmod 600"):
        accounts.find("ada", PASSWORD)
    path.chmod(0o600)
    path.write_text('{"accounts": {"ada": {"role": "root"}}}')
    with pytest.raises(AccountsError, match="not a file of accounts"):
        accounts.names()


@pytest.mark.parametrize("name", ["", "../x", "a b", "-rf", "a\n", "x" * 41, "<b>"])
def test_a_name_with_signs_is_no_account(tmp_path: Path, name: str) -> None:
    with pytest.raises(AccountsError):
        Accounts(tmp_path / "accounts.json", 2**4).put(name, Role.VIEWER, PASSWORD)


@pytest.mark.parametrize("password", ["", "short", "x" * 201])
def test_a_password_is_neither_short_nor_endless(tmp_path: Path, password: str) -> None:
    with pytest.raises(AccountsError):
        Accounts(tmp_path / "accounts.json", 2**4).put("ada", Role.VIEWER, password)


def test_two_accounts_with_one_password_have_different_hashes(tmp_path: Path) -> None:
    accounts = Accounts(tmp_path / "accounts.json", 2**4)
    accounts.put("ada", Role.VIEWER, PASSWORD)
    accounts.put("bob", Role.VIEWER, PASSWORD)
    stored = json.loads((tmp_path / "accounts.json").read_text())["accounts"]
    assert stored["ada"]["hash"] != stored["bob"]["hash"]
    accounts.remove("ada")
    assert accounts.find("ada", PASSWORD) is None
    assert accounts.find("bob", PASSWORD) is not None


def test_an_account_hashed_in_one_pass_still_logs_in(tmp_path: Path) -> None:
    """As the files of 0.2.0, which name no passes."""
    path = tmp_path / "accounts.json"
    salt = b"0123456789abcdef"
    digest = scrypt(PASSWORD.encode(), salt=salt, n=2**4, r=8, p=1, dklen=32)
    one = {
        "role": "viewer",
        "salt": b64encode(salt).decode(),
        "hash": b64encode(digest).decode(),
        "cost": 2**4,
    }
    path.write_text(json.dumps({"accounts": {"ada": one}}))
    path.chmod(0o600)
    accounts = Accounts(path)
    assert accounts.find("ada", PASSWORD) is not None
    assert accounts.find("ada", PASSWORD + "x") is None
    accounts.put("ada", Role.VIEWER, PASSWORD)  # hashed anew, at today's cost
    assert accounts.find("ada", PASSWORD) is not None


def test_the_accounts_stand_in_the_users_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", "/somewhere")
    assert accounts_path() == Path("/somewhere/cellctl/accounts.json")


@pytest.mark.parametrize(
    "origin",
    [
        "http://cell.example",
        "cell.example",
        "https://",
        "https://a@b",
        "https://a/b",
        "https://a?x",
    ],
)
def test_a_proxy_is_named_by_its_origin(origin: str) -> None:
    with pytest.raises(ValueError, match="is not like"):
        PageAddress.behind(origin)


@contextmanager
def served(folder: Path) -> Iterator[int]:
    """Serve the page at a free port in a thread, as the command does."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    there = bench(folder, PageAddress.served("127.0.0.1", port, with_tls=False))
    page = there.page
    app = serving_module.build(folder / "runs", folder, page.site, page.accounts, page.sessions)
    server = serving_module.server_of(app, serving_module.Serving("127.0.0.1", port))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        while not server.started:
            time.sleep(0.02)
        yield port
    finally:
        server.should_exit = True
        thread.join()


def test_slow_clients_are_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_module, "HEADER_WALL_S", 0.5)
    monkeypatch.setattr("controller.page.security.guard.BODY_WALL_S", 0.5)
    with served(tmp_path) as port:
        head = f"POST /login HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n".encode()
        body = f"Origin: http://127.0.0.1:{port}\r\nContent-Length: 100\r\n\r\n".encode()
        for sent in (b"", head, head + body + b"name="):
            with socket.create_connection(("127.0.0.1", port), timeout=600.0) as slow:
                slow.sendall(sent)
                answer = b""
                with suppress(ConnectionResetError):
                    while more := slow.recv(4096):
                        answer += more
            assert answer == b"" or b" 408 " in answer.split(b"\r\n")[0]


@pytest.mark.parametrize(
    "sent",
    [
        b"GET /now HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nHost: evil.example\r\n\r\n",
        b"GET /now HTTP/1.1\r\n\r\n",
        b"POST /login HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nContent-Length: 5\r\n"
        b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        b"GET /now HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nX: " + b"x" * 40_000 + b"\r\n\r\n",
        b"GET /now HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nX: a\r\n b\x00\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"GET http://evil.example/ HTTP/1.1\r\nHost: evil.example\r\n\r\n",
    ],
)
def test_what_is_no_request_of_a_browser_is_refused(tmp_path: Path, sent: bytes) -> None:
    with served(tmp_path) as port:
        with socket.create_connection(("127.0.0.1", port), timeout=600.0) as wire:
            wire.sendall(sent.replace(b"PORT", str(port).encode()))
            wire.shutdown(socket.SHUT_WR)
            answer = wire.recv(65536)
        assert answer == b"" or answer.split(b" ")[1][:1] == b"4"
        with socket.create_connection(("127.0.0.1", port), timeout=600.0) as wire:
            wire.sendall(f"GET /login HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            assert b" 200 " in wire.recv(65536)  # and it still serves


def test_without_a_certificate_nothing_is_served_as_https(tmp_path: Path) -> None:
    (tmp_path / "cert.pem").write_text("nothing")
    wrong = serving_module.Serving("127.0.0.1", 1, tmp_path / "cert.pem", tmp_path / "cert.pem")
    with pytest.raises(ssl.SSLError):
        serving_module.server_of(bench(tmp_path).client.app, wrong)  # type: ignore[arg-type]
