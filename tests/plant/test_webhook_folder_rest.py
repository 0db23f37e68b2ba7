"""Webhook, folder and REST: what a stranger sees at each, and what none of them lets through."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from fake_plant import FakePlant, alarm_notice, part_result
from pydantic import ValidationError
from starlette.testclient import TestClient
from web_receiver import Receiver, receiving

from controller.config.cell.connect import (
    ConnectSection,
    FolderSection,
    RestSection,
    WebhookSection,
)
from controller.plant.plant import PlantError, RejectedError
from controller.plant.schema import document, document_bytes
from controller.plant.wires.folder import Folder, FolderError, stem_of
from controller.plant.wires.rest import BODY_MAX_BYTES, RestWire
from controller.plant.wires.webhook import SIGNATURE, Webhook, WebhookError

ROOT = Path(__file__).resolve().parents[2]
SECRET = "a secret of more than 16 signs"


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with receiving() as found:
        yield found


def webhook(folder: Path, url: str, secret: str = SECRET, mode: int = 0o600) -> Webhook:
    path = folder / "secret"
    path.write_text(secret + "\n")
    path.chmod(mode)
    return Webhook(WebhookSection(url=url, secret_file=Path("secret")), folder)


def openssl_hmac(body: bytes) -> str:
    command = ["openssl", "dgst", "-sha256", "-hmac", SECRET]
    return subprocess.run(command, input=body, capture_output=True, check=True).stdout.decode()


async def test_a_webhook_signs_what_it_sends_so_that_openssl_agrees(
    tmp_path: Path, receiver: Receiver
) -> None:
    result = part_result()
    await webhook(tmp_path, receiver.url).deliver(result)
    ((headers, body),) = receiver.got
    assert json.loads(body) == result.model_dump(mode="json", by_alias=True)
    assert headers["Idempotency-Key"] == result.key
    assert headers["path"] == "/hook?plant=3"
    said = await asyncio.to_thread(openssl_hmac, body)
    assert headers[SIGNATURE] == f"sha256={said.split()[-1]}"


@pytest.mark.parametrize(
    ("status", "error"),
    [
        (200, None), (202, None), (301, WebhookError), (400, RejectedError), (404, RejectedError),
        (408, WebhookError), (425, WebhookError), (429, WebhookError), (500, WebhookError),
        (503, WebhookError),
    ],
)  # fmt: skip
async def test_only_a_servers_yes_confirms_and_only_a_plain_no_is_for_good(
    tmp_path: Path, receiver: Receiver, status: int, error: type[Exception] | None
) -> None:
    receiver.answers = [status]
    sending = webhook(tmp_path, receiver.url).deliver(alarm_notice())
    if error is None:
        await sending
        return
    with pytest.raises(error, match=str(status)) as raised:
        await sending
    assert SECRET not in str(raised.value)


async def test_a_server_that_is_not_there_is_tried_again(tmp_path: Path) -> None:
    with pytest.raises(WebhookError, match="refused"):
        await webhook(tmp_path, "http://127.0.0.1:1/").deliver(part_result())


@pytest.mark.parametrize(
    ("secret", "mode", "why"),
    [("short", 0o600, "16 or more"), (SECRET, 0o644, "chmod 600")],
)
def test_a_secret_that_others_may_read_or_guess_is_refused(
    tmp_path: Path, secret: str, mode: int, why: str
) -> None:
    with pytest.raises(PlantError, match=why):
        webhook(tmp_path, "https://mes.example/", secret, mode)
    with pytest.raises(PlantError, match=r"no such file.*openssl rand"):
        Webhook(WebhookSection(url="https://x.example/", secret_file=Path("none")), tmp_path)


def folder_wire(folder: Path, **more: Any) -> tuple[Folder, Path]:
    out = folder / "out"
    out.mkdir(exist_ok=True)
    return Folder(FolderSection(path=Path("out"), **more), folder), out


async def served(wire: Folder) -> asyncio.Task[None]:
    return asyncio.create_task(wire.serve(FakePlant()))


async def test_a_folder_gets_whole_files_of_each_kind_and_none_of_an_alarm(tmp_path: Path) -> None:
    wire, out = folder_wire(tmp_path, formats=("json", "csv"))
    serving = await served(wire)
    await wire.deliver(part_result())
    await wire.deliver(alarm_notice())
    stem = "PO-4711_SN-0001_20261128-101500-123-holder_1"
    assert sorted(path.name for path in out.iterdir()) == [f"{stem}.csv", f"{stem}.json"]
    assert json.loads((out / f"{stem}.json").read_text())["schema"] == "cellctl.part/1"
    serving.cancel()


async def test_a_file_is_never_overwritten_and_a_result_twice_is_one_file(tmp_path: Path) -> None:
    wire, out = folder_wire(tmp_path, name="{serial}")
    serving = await served(wire)
    await wire.deliver(part_result())
    await wire.deliver(part_result())
    other = part_result(run="20261129-101500-123-holder")
    await wire.deliver(other)
    assert sorted(path.name for path in out.iterdir()) == ["SN-0001.json", "SN-0001~1.json"]
    assert json.loads((out / "SN-0001~1.json").read_text())["run"] == other.run
    serving.cancel()


@pytest.mark.parametrize(
    "serial", ["../../etc/x", "a/b", ".hidden", "CON\n", "ü 1", "x" * 80, None]
)
def test_a_serial_number_names_no_other_folder(serial: str | None) -> None:
    stem = stem_of("{order}_{serial}", part_result(serial=serial))
    assert "/" not in stem
    assert "\n" not in stem
    assert not stem.startswith(".")
    assert stem.startswith("PO-4711_")


def test_a_second_revision_has_a_name_of_its_own() -> None:
    assert stem_of("{serial}", part_result(revision=2)) == "SN-0001_r2"
    assert stem_of("{serial}-{revision}", part_result(revision=2)) == "SN-0001-2"


async def test_a_share_that_goes_away_leaves_the_result_to_be_tried_again(tmp_path: Path) -> None:
    wire, out = folder_wire(tmp_path)
    serving = await served(wire)
    out.rmdir()
    with pytest.raises(FolderError, match="No such file"):
        await wire.deliver(part_result())
    out.mkdir()
    await wire.deliver(part_result())
    assert len(list(out.iterdir())) == 1
    serving.cancel()


async def test_a_share_that_hangs_does_not_hang_the_bridge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire, out = folder_wire(tmp_path)
    serving = await served(wire)
    os.mkfifo(out / "PO-4711_SN-0001_20261128-101500-123-holder_1.json")  # whoever opens it waits
    monkeypatch.setattr("controller.plant.wires.folder.WRITE_WALL_S", 1.0)
    with pytest.raises(FolderError, match="hangs"):
        await wire.deliver(part_result())
    serving.cancel()


@pytest.mark.slow
async def test_whoever_watches_the_folder_sees_a_thousand_whole_files(tmp_path: Path) -> None:
    if shutil.which("inotifywait") is None:
        pytest.skip("needs inotifywait (Debian: inotify-tools)")
    wire, out = folder_wire(tmp_path, name="{serial}")
    serving = await served(wire)
    watch = await asyncio.create_subprocess_exec(
        "inotifywait", "-m", "--format", "%e %f", str(out),
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    assert watch.stdout is not None
    assert watch.stderr is not None
    while b"established" not in await watch.stderr.readline():
        pass
    count = 1000
    seen: set[str] = set()

    async def look() -> None:
        assert watch.stdout is not None
        while len(seen) < count:
            event, _, name = (await watch.stdout.readline()).decode().strip().partition(" ")
            if not name or name.startswith("."):  # the folder itself; a file that is not whole
                continue
            # nothing is written or made under its own name: it comes whole
            assert event in ("MOVED_TO", "CLOSE_NOWRITE,CLOSE", "OPEN", "ACCESS"), (event, name)
            if event == "MOVED_TO":
                serial = json.loads((out / name).read_text())["serial"]
                assert name == f"{serial}.json"
                seen.add(name)

    looking = asyncio.create_task(look())
    for part in range(1, count + 1):
        await wire.deliver(part_result(part))
    await looking
    watch.send_signal(signal.SIGTERM)
    await watch.wait()
    serving.cancel()


@pytest.mark.parametrize("name", ["{user}", "{serial.__class__}", "../{serial}", ".{serial}", "{"])
def test_a_folders_name_has_known_blanks_alone(name: str) -> None:
    with pytest.raises(ValidationError):
        FolderSection(path=Path("out"), name=name)


class Client:
    """A plant system that asks by REST."""

    def __init__(self, plant: FakePlant) -> None:
        self.plant = plant
        app = RestWire(RestSection(), Path()).app(plant)
        self.http = TestClient(app, raise_server_exceptions=True)
        self.auth = ("mes", "correct horse battery")

    def ask(self, method: str, path: str, **more: Any) -> Any:
        if "headers" not in more:
            more["auth"] = self.auth
        return self.http.request(method, f"/api/v1{path}", **more)


@pytest.fixture
def client() -> Client:
    plant = FakePlant()
    for part in (1, 2, 3):
        plant.finish(part_result(part))
    return Client(plant)


def fits(name: str, found: Any) -> None:
    """Hold an answer against the description that others build their clients by."""
    schema = {**document(), "$ref": f"#/components/schemas/{name}"}
    jsonschema.Draft202012Validator(schema).validate(found)


def test_state_recipes_and_parts_are_as_described(client: Client) -> None:
    fits("CellState", client.ask("GET", "/state").json())
    for one in client.ask("GET", "/recipes").json():
        fits("Offer", one)
    parts = client.ask("GET", "/parts", params={"after": 101, "limit": 1}).json()
    assert [one["part"] for one in parts] == [2]
    fits("PartResult", parts[0])
    run = parts[0]["run"]
    assert client.ask("GET", f"/parts/{run}/2").json() == parts[0]
    assert client.ask("GET", f"/parts/{run}/2/report").json()["part"] == 2


def test_an_order_is_put_read_and_taken_back(client: Client) -> None:
    body = {"recipe": "holder", "serials": ["SN-1", "SN-2"], "due": "2026-12-01T06:00:00Z"}
    first = client.ask("PUT", "/orders/PO-1", json=body)
    fits("OrderState", first.json())
    assert client.ask("PUT", "/orders/PO-1", json=body).json() == first.json()
    assert client.ask("GET", "/orders/PO-1").json()["request"]["serials"] == ["SN-1", "SN-2"]
    assert len(client.ask("GET", "/orders").json()) == 1
    assert client.ask("DELETE", "/orders/PO-1").status_code == 200
    assert client.plant.told[0] == ("order", "PO-1", "mes by REST")


@pytest.mark.parametrize(
    ("method", "path", "more", "status"),
    [
        ("GET", "/parts/x/1", {}, 404),
        ("GET", "/parts/x/one", {}, 404),
        ("GET", "/parts/x/9999999999", {}, 404),
        ("GET", "/parts", {"params": {"after": "-1"}}, 422),
        ("GET", "/parts", {"params": {"limit": "501"}}, 422),
        ("GET", "/parts?after=1&after=2", {}, 422),
        ("GET", "/orders/none", {}, 404),
        ("DELETE", "/orders/none", {}, 404),
        ("PUT", "/orders/PO-1", {"content": b"\xff"}, 422),
        ("PUT", "/orders/PO-1", {"json": {"recipe": "holder", "may_start": "yes"}}, 422),
        ("PUT", "/orders/PO-1", {"json": []}, 422),
        ("PUT", "/orders/PO-1", {"content": b"x" * (BODY_MAX_BYTES + 1)}, 413),
        ("POST", "/stop", {"json": {"why": 1}}, 422),
        ("POST", "/stop", {"content": b"["}, 422),
        ("POST", "/stop", {}, 409),
        ("POST", "/start", {}, 404),
        ("POST", "/answer", {}, 404),
        ("POST", "/state", {}, 405),
    ],
)
def test_a_wrong_request_gets_a_sentence(
    client: Client, method: str, path: str, more: dict[str, Any], status: int
) -> None:
    answer = client.ask(method, path, **more)
    assert answer.status_code == status, answer.text
    assert answer.json()["error"]


@pytest.mark.parametrize(
    "header",
    [
        None, "", "Basic", "Basic !!!", "Bearer correct horse battery",
        f"Basic {base64.b64encode(b'mes:wrong password').decode()}",
        f"Basic {base64.b64encode(b'nobody:correct horse battery').decode()}",
        f"Basic {base64.b64encode(b'mes').decode()}",
    ],
)  # fmt: skip
def test_nobody_gets_in_without_an_account(client: Client, header: str | None) -> None:
    headers: dict[str, str] = {} if header is None else {"Authorization": header}
    for method, path in (("GET", "/state"), ("PUT", "/orders/PO-1"), ("POST", "/stop")):
        assert client.ask(method, path, headers=headers).status_code == 401
    assert client.plant.told == []


def test_a_password_is_not_guessed_by_trying_many(client: Client) -> None:
    client.auth = ("mes", "guess")
    statuses = {client.ask("GET", "/state").status_code for _ in range(30)}
    assert statuses == {401, 429}
    client.auth = ("mes", "correct horse battery")
    assert client.ask("GET", "/state").status_code == 429  # the right one waits as well


def test_a_password_is_checked_once_and_again_when_its_account_changes(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("controller.plant.wires.rest.KNOWN_WALL_S", 0.0)
    for _ in range(3):
        assert client.ask("GET", "/state").status_code == 200
    assert client.plant.checked == 1
    client.plant.passwords["mes"] = "another horse battery"
    assert client.ask("GET", "/state").status_code == 401
    client.auth = ("mes", "another horse battery")
    assert client.ask("GET", "/state").status_code == 200
    del client.plant.passwords["mes"]
    assert client.ask("GET", "/state").status_code == 401


def test_other_addresses_than_this_machines_need_a_certificate() -> None:
    with pytest.raises(PlantError, match="tls_cert"):
        RestWire(RestSection(listen="0.0.0.0:8471"), Path())
    with pytest.raises(ValidationError):
        RestSection(tls_cert=Path("cert.pem"))
    assert ConnectSection().may_start == "never"


def test_the_description_is_stored() -> None:
    stored = (ROOT / "docs" / "plant-api.json").read_bytes()
    assert stored == document_bytes(), "python -m controller.plant.schema > docs/plant-api.json"
