"""Every address of the page, as the application has it: none is without its checks."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import CHEAP, ORIGIN, Bench, Clock, bench
from pydantic import Field
from starlette.applications import Starlette
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.testclient import TestClient

from controller.page.app import SCREENS, build_app, build_screens
from controller.page.frame import (
    GetRoute,
    PageFrame,
    PostBody,
    PostRoute,
    Screen,
    Setting,
    Upload,
    Uploaded,
    Visit,
)
from controller.page.frame.routing import routes_of
from controller.page.now.live import Live
from controller.page.security import Accounts, PageAddress, Role, Sessions

# Answered without a session: the way in and out, and the page's own files.
OPEN = {
    ("GET", "/"),
    ("GET", "/login"),
    ("POST", "/login"),
    ("GET", "/enter"),
    ("POST", "/logout"),  # leads to the log-in, or requires the token
    ("GET", "/session"),  # says 401
    ("GET", "/static/{name:path}"),
}
NUMBERS = {"int": "1", "str": "x", "path": "x", "float": "1.0"}


def every_route(tmp: Path) -> list[tuple[str, str]]:
    found = bench(tmp).page
    return [
        (method, route.path)
        for route in build_app(found).routes
        if isinstance(route, Route)
        for method in sorted((route.methods or set()) - {"HEAD"})
    ]


def declared() -> list[tuple[str, str, Role]]:
    screens = build_screens(Setting(Path("nowhere"), Path("nowhere")))
    return [
        ("GET" if isinstance(one, GetRoute) else "POST", screen.address(one.path), one.role)
        for screen in screens
        for one in screen.answers
    ]


DECLARED = declared()
IDS = [f"{method} {path}" for method, path, _ in DECLARED]


def filled(path: str) -> str:
    """Return an address with something in place of its parameters."""
    return re.sub(r"\{\w+:?(\w*)\}", lambda found: NUMBERS[found[1] or "str"], path)


@pytest.fixture(scope="module")
def at(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return bench(tmp_path_factory.mktemp("page"))


@pytest.fixture(autouse=True)
def logged_out(at: Bench) -> None:
    at.client.cookies.clear()


def ask(at: Bench, method: str, path: str, csrf: str, **headers: str) -> int:
    if method == "GET":
        return at.client.get(filled(path), headers=headers).status_code
    sent = {"Origin": ORIGIN, "X-CSRF-Token": csrf, "Content-Type": "application/json", **headers}
    return at.client.post(filled(path), content=b"{}", headers=sent).status_code


def test_every_address_is_open_on_purpose_or_declared_by_a_screen(tmp_path: Path) -> None:
    expected = OPEN | {(method, path) for method, path, _ in DECLARED}
    assert set(every_route(tmp_path)) == expected
    assert len(every_route(tmp_path)) == len(expected)


def test_every_screen_has_its_place_in_the_bar_and_is_in_it(at: Bench) -> None:
    names = [screen.name for screen in at.page.screens]
    assert len(SCREENS) == len(names) == len(set(names))
    assert names == ["now", "review", "history", "recipes", "cell"]
    at.log_in(Role.ENGINEER)
    text = at.client.get("/now").text
    assert re.findall(r'<a href="/(\w+)"', text.split("<nav")[1].split("</nav>")[0]) == names


@pytest.mark.parametrize(("method", "path", "role"), DECLARED, ids=IDS)
def test_nobody_gets_in_without_a_session(at: Bench, method: str, path: str, role: Role) -> None:
    assert ask(at, method, path, "") in (303, 401)
    assert ask(at, method, path, "x" * 43, Cookie="cellctl=" + "x" * 43) in (303, 401)


@pytest.mark.parametrize(("method", "path", "role"), DECLARED, ids=IDS)
def test_a_lesser_role_is_refused(at: Bench, method: str, path: str, role: Role) -> None:
    for lesser in [other for other in Role if Role.VIEWER <= other < role]:
        at.client.cookies.clear()
        csrf = at.log_in(lesser)
        assert ask(at, method, path, csrf) == 403
    assert method == "GET" or role >= Role.OPERATOR  # a viewer does nothing


@pytest.mark.parametrize(("method", "path", "role"), DECLARED, ids=IDS)
def test_another_page_gets_nothing(at: Bench, method: str, path: str, role: Role) -> None:
    csrf = at.log_in(role)
    assert ask(at, method, path, csrf, Origin="http://evil.example") == 403
    if method == "POST":
        assert ask(at, method, path, csrf, **{"Sec-Fetch-Site": "cross-site"}) == 403


@pytest.mark.parametrize(
    ("method", "path", "role"),
    [(method, path, role) for method, path, role in DECLARED if method == "POST"],
)
def test_an_act_without_the_token_of_its_session_is_refused(
    at: Bench, method: str, path: str, role: Role
) -> None:
    own = at.log_in(role)
    assert ask(at, method, path, "") == 403
    assert ask(at, method, path, own[:-1] + ("a" if own[-1] != "a" else "b")) == 403
    headers = {"Origin": ORIGIN, "Content-Type": "application/json"}
    assert at.client.post(filled(path), content=b"{}", headers=headers).status_code == 403


@pytest.mark.parametrize(("method", "path", "role"), DECLARED, ids=IDS)
def test_an_address_answers_its_own_method_alone(
    at: Bench, method: str, path: str, role: Role
) -> None:
    csrf = at.log_in(role)
    other = "GET" if method == "POST" else "POST"
    if (other, path) not in {(m, p) for m, p, _ in DECLARED}:
        assert ask(at, other, path, csrf) in (404, 405)
    for strange in ("PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"):
        assert at.client.request(strange, filled(path)).status_code == 405


# A screen of the test's own: what the frame does for every screen.


class NameBody(PostBody):
    name: str = Field(max_length=10)


class Small:
    def __init__(self) -> None:
        self.got: list[tuple[str, bytes]] = []
        self.left: list[Path] = []

    async def look(self, visit: Visit) -> Response:
        return JSONResponse({"who": visit.who})

    async def act(self, visit: Visit, body: NameBody) -> Response:
        return JSONResponse({"who": visit.who, "name": body.name})

    async def take(self, _: Visit, file: Uploaded) -> Response:
        self.got.append((file.name, file.path.read_bytes()))
        self.left.append(file.path)
        return JSONResponse({"size": file.path.stat().st_size})


LIMIT = 200_000


@pytest.fixture
def small(tmp_path: Path) -> tuple[Small, Bench]:
    answers = Small()
    screen = Screen(
        "frame",  # the one package that is there and is no screen
        "PageFrame",
        (
            GetRoute("look", answers.look),
            PostRoute("act", NameBody, answers.act, Role.OPERATOR),
            Upload("file", LIMIT, frozenset({".stl", ".3mf"}), answers.take, Role.ENGINEER),
        ),
    )
    page = PageFrame(
        PageAddress.served("127.0.0.1", 8470, with_tls=False),
        Accounts(tmp_path / "accounts.json", CHEAP),
        Sessions(),
        (*build_screens(Setting(tmp_path, tmp_path)), screen),
    )
    app: Starlette = build_app(page)
    client = TestClient(app, base_url=ORIGIN, follow_redirects=False)
    return answers, Bench(page, client, Clock(), Live(tmp_path))


def upload(at: Bench, csrf: str, name: str, content: Any, **headers: str) -> int:
    reply = at.client.post(
        "/frame/file",
        params={"name": name},
        content=content,
        headers={"Origin": ORIGIN, "X-CSRF-Token": csrf, **headers},
    )
    return reply.status_code


def test_a_file_arrives_whole_with_its_name_and_is_gone_afterwards(
    small: tuple[Small, Bench],
) -> None:
    answers, at = small
    content = bytes(range(256)) * 700
    assert upload(at, at.log_in(Role.ENGINEER), "part (2).STL", content) == 200
    assert answers.got == [("part (2).STL", content)]
    assert [path.exists() or path.parent.exists() for path in answers.left] == [False]


@pytest.mark.parametrize(
    "name",
    [
        "",
        "../part.stl",
        "/etc/part.stl",
        "a/b.stl",
        "a\\b.stl",
        ".stl",
        "-rf.stl",
        "a\x00.stl",
        "a\n.stl",
        "x" * 101 + ".stl",
        "<b>.stl",
        "%2e%2e.stl",
    ],
)
def test_a_name_that_leads_elsewhere_is_refused(small: tuple[Small, Bench], name: str) -> None:
    answers, at = small
    assert upload(at, at.log_in(Role.ENGINEER), name, b"solid") in (415, 422)
    assert answers.got == []


@pytest.mark.parametrize("name", ["part.py", "part", "part.stl.sh", "part.yaml"])
def test_a_file_of_another_kind_is_refused(small: tuple[Small, Bench], name: str) -> None:
    answers, at = small
    assert upload(at, at.log_in(Role.ENGINEER), name, b"solid") == 415
    assert answers.got == []


def test_a_file_that_is_too_large_is_refused_before_it_is_read(
    small: tuple[Small, Bench],
) -> None:
    answers, at = small
    csrf = at.log_in(Role.ENGINEER)
    ten_gb = {"Content-Length": str(10_000_000_000)}
    assert upload(at, csrf, "part.stl", b"solid", **ten_gb) == 413
    assert upload(at, csrf, "part.stl", b"x" * (LIMIT + 1)) == 413
    assert upload(at, csrf, "part.stl", (b"x" * 1000 for _ in range(300))) == 411  # no length
    assert answers.got == []


def test_nobody_who_may_not_send_a_file_has_it_read(small: tuple[Small, Bench]) -> None:
    answers, at = small
    assert upload(at, "", "part.stl", b"solid") == 401
    assert upload(at, at.log_in(Role.OPERATOR), "part.stl", b"solid") == 403
    at.client.cookies.clear()
    at.log_in(Role.ENGINEER)
    assert upload(at, "", "part.stl", b"solid") == 403
    assert answers.got == []


def test_an_archive_that_unpacks_to_too_much_is_refused(
    small: tuple[Small, Bench], tmp_path: Path
) -> None:
    answers, at = small
    csrf = at.log_in(Role.ENGINEER)
    bomb, many, sound = (tmp_path / f"{name}.3mf" for name in ("bomb", "many", "sound"))
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b"0" * 50_000_000)
    with zipfile.ZipFile(many, "w") as archive:
        for number in range(1_001):
            archive.writestr(str(number), b"")
    with zipfile.ZipFile(sound, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b"<vertex x='1.25' y='3.5'/>" * 100)
    assert upload(at, csrf, "bomb.3mf", bomb.read_bytes()) == 422
    assert upload(at, csrf, "many.3mf", many.read_bytes()) == 422
    assert upload(at, csrf, "sound.3mf", sound.read_bytes()) == 200
    assert [name for name, _ in answers.got] == ["sound.3mf"]


def test_an_act_gets_its_body_and_who_does_it(small: tuple[Small, Bench]) -> None:
    _, at = small
    headers = {"Origin": ORIGIN, "X-CSRF-Token": at.log_in(Role.OPERATOR)}
    reply = at.client.post("/frame/act", json={"name": "x"}, headers=headers)
    assert reply.json() == {"who": "ada, page", "name": "x"}
    reply = at.client.post("/frame/act", json={"name": "x" * 11}, headers=headers)
    assert reply.status_code == 422
    reply = at.client.post("/frame/act", content=b'{"name": "x"}', headers=headers)
    assert reply.status_code == 415


def test_two_answers_at_one_address_are_a_mistake(small: tuple[Small, Bench]) -> None:
    answers, at = small
    twice = Screen("frame", "PageFrame", (GetRoute("a", answers.look), GetRoute("a", answers.look)))
    page = PageFrame(at.page.site, at.page.accounts, at.page.sessions, (twice,))
    with pytest.raises(ValueError, match="answered twice"):
        routes_of(page)
