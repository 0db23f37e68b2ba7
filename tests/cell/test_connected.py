"""A whole cell in a plant: an order by REST, the bridge killed meanwhile, the result everywhere."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import pytest
from web_receiver import Receiver, receiving

ROOT = Path(__file__).parents[2]
LIMIT_S = 1500.0  # a guard against a hang, no measure
PASSWORD = "of this test alone"


class Plant:
    """A plant system: gets results by webhook, asks and orders by REST."""

    def __init__(self, receiver: Receiver) -> None:
        self.receiver = receiver
        self.rest = ""

    @property
    def got(self) -> list[dict[str, Any]]:
        return [json.loads(body) for _, body in self.receiver.got]

    def ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        account = base64.b64encode(f"mes:{PASSWORD}".encode()).decode()
        data = None if body is None else json.dumps(body).encode()
        asked = Request(
            f"http://{self.rest}/api/v1{path}",
            data,
            {"Authorization": f"Basic {account}"},
            method=method,
        )
        with urlopen(asked, timeout=60) as answer:
            return json.load(answer)

    def until(self, is_so: Any) -> None:
        end_s = time.monotonic() + LIMIT_S
        while not is_so():
            assert time.monotonic() < end_s
            time.sleep(0.2)


@pytest.fixture
def plant() -> Iterator[Plant]:
    with receiving() as receiver:
        yield Plant(receiver)


class Bridge:
    """`cellctl connect`, which a test may kill and begin again."""

    def __init__(self, folder: Path, plant: Plant) -> None:
        self.folder = folder
        self.runs = folder / "runs"
        self.environment = {**os.environ, "XDG_CONFIG_HOME": str(folder / "config")}
        text = (ROOT / "recipes" / "cells" / "emulated.yaml").read_text(encoding="utf-8")
        port = 20000 + os.getpid() % 20000
        plant.rest = f"127.0.0.1:{port}"
        (folder / "cell.yaml").write_text(
            f"{text}\nconnect:\n  may_start: yes\n  rest: {{listen: '{plant.rest}'}}\n"
            f"  webhook: [{{url: '{plant.receiver.url}', secret_file: secret}}]\n"
            "  folder: [{path: out, name: '{order}_{serial}'}]\n"
        )
        (folder / "out").mkdir()
        (folder / "secret").write_text("a secret of this test alone")
        (folder / "secret").chmod(0o600)
        self.cellctl("account", "mes", "--role", "plant", said=PASSWORD)
        self.begin()

    def cellctl(self, *words: str, said: str = "") -> str:
        done = subprocess.run(
            [sys.executable, "-m", "controller.cli", *words],
            input=said, capture_output=True, text=True, env=self.environment, cwd=self.folder,
            timeout=LIMIT_S, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    def begin(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "controller.cli", "connect", "--cell", "cell.yaml", "--speed",
             "10", "--seed", "11", "--json"],
            stdout=subprocess.PIPE, env=self.environment, cwd=self.folder,
        )  # fmt: skip
        assert self.process.stdout is not None
        assert json.loads(self.process.stdout.readline())["event"] == "ready"

    def end(self, by: signal.Signals) -> int:
        self.process.send_signal(by)
        code = self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()
        return code


@pytest.mark.slow
@pytest.mark.timeout(2 * LIMIT_S)
def test_an_order_ends_with_its_result_though_the_bridge_is_killed_meanwhile(
    tmp_path: Path, plant: Plant
) -> None:
    bridge = Bridge(tmp_path, plant)
    try:
        plant.until(lambda: is_up(plant))
        order = {"recipe": "holder", "serials": ["SN-1"], "lot": "L7"}
        plant.ask("PUT", "/orders/PO-1", order)
        plant.until(lambda: plant.ask("GET", "/state")["state"].startswith("execute"))
        assert plant.ask("GET", "/state")["order"] == "PO-1"
        bridge.end(signal.SIGKILL)
        lock = tmp_path / "runs" / "cell.lock"
        assert json.loads(lock.read_text())["control"]  # the run goes on
        bridge.begin()
        plant.until(lambda: is_up(plant))
        plant.ask("PUT", "/orders/PO-1", order)  # the plant asks again: nothing is started twice
        plant.until(lambda: plant.ask("GET", "/orders/PO-1")["state"] != "running")
        ended = plant.ask("GET", "/orders/PO-1")
        assert (ended["state"], ended["done"], ended["accepted"]) == ("done", 1, 1)
        plant.until(lambda: list((tmp_path / "out").glob("*.json")))
        plant.until(lambda: any("verdict" in one for one in plant.got))
    finally:
        assert bridge.end(signal.SIGTERM) == 0
    runs = [path.name for path in (tmp_path / "runs").iterdir() if re.match(r"\d{8}-", path.name)]
    assert runs == [ended["run"]]
    parts = {json.dumps(one, sort_keys=True) for one in plant.got if "verdict" in one}
    (part,) = map(json.loads, parts)
    assert (part["serial"], part["lot"], part["order"]) == ("SN-1", "L7", "PO-1")
    (file,) = (tmp_path / "out").glob("*.json")
    assert (file.name, json.loads(file.read_text())) == ("PO-1_SN-1.json", part)
    report = json.loads(bridge.cellctl("report", "--format", "json"))
    (reported,) = report["parts"]
    assert part["verdict"] == reported["verdict"] == "pass"
    measured = {c["id"]: c["measured"] for c in reported["characteristics"]}
    assert {c["id"]: c["measured"] for c in part["characteristics"]} == measured
    for picture in part["pictures"]:
        content = (tmp_path / "runs" / part["run"] / picture["name"]).read_bytes()
        assert hashlib.sha256(content).hexdigest() == picture["sha256"]


def is_up(plant: Plant) -> bool:
    try:
        plant.ask("GET", "/state")
    except OSError:
        return False
    return True
