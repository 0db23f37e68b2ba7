"""A page before a journal that was written here, and a browser without a screen."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from starlette.testclient import TestClient

from controller.cell.journal import JOURNAL_NAME, Journal, rows
from controller.config import load_cell
from controller.page import now
from controller.page.app import build_app, build_screens
from controller.page.frame import PageFrame, Setting
from controller.page.now.live import Live
from controller.page.security import Account, Accounts, Attempts, PageAddress, Role, Sessions

ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
RUN = "20261124-080000-001-holder"
ORIGIN = "http://127.0.0.1:8470"
PASSWORD = "correct horse battery"
CHEAP = 2**4  # scrypt's least cost: what a hash costs is no matter of these tests
HERE = (0.5, -0.25, 0.5, -100.0, -1.0, 0.25)
THERE = (0.25, 0.5, 0.25, -300.0, -0.5, 0.5)
EYE = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


class Clock:
    """Seconds that go by when the test says so."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def journal(
    runs: Path, run: str = RUN, *, with_cell: bool = True, part: Path | None = None
) -> Journal:
    """Return the journal of a run that has begun; without a cell there is nothing to draw."""
    runs.mkdir(exist_ok=True)
    found = Journal(runs / JOURNAL_NAME, run)
    cell = load_cell(CELL).model_dump(mode="json") if with_cell else {}
    recipe = {"name": "holder", "part": "none.stl" if part is None else str(part), "unit": "mm"}
    files = {} if part is None else {str(part): hashlib.sha256(part.read_bytes()).hexdigest()}
    found.write(rows.RunBegan(recipe=recipe, cell=cell, count=3, speed=2.0, files=files))
    return found


def picture(runs: Path, name: str, run: str = RUN) -> Path:
    """Write a picture, 1280 x 1024, and return its file."""
    path = runs / run / name
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((1024, 1280), 90, np.uint8))
    return path


@dataclass
class Bench:
    """A page, and what it stands on.

    `client` logs in as nobody until `log_in`.
    """

    page: PageFrame
    client: TestClient
    clock: Clock
    live: Live

    def read(self) -> None:
        """Have the poller look at the journal once."""
        self.live.look()

    def log_in(self, role: Role = Role.OPERATOR, name: str = "ada") -> str:
        """Log in by a link; return the token that orders must carry."""
        token = self.page.sessions.link(Account(name, role))
        self.client.get(f"/enter?token={token}")
        return self.csrf()

    def csrf(self) -> str:
        """Return the token in the page."""
        found = re.search(r'name="csrf" content="([^"]+)"', self.client.get("/now").text)
        assert found is not None
        return found[1]

    def act(self, name: str, body: object, csrf: str, **headers: str) -> tuple[int, str]:
        """Send an order to the cell as the page does; return status and text."""
        return self.post(f"/now/act/{name}", body, csrf, **headers)

    def post(self, path: str, body: object, csrf: str, **headers: str) -> tuple[int, str]:
        """Send an act as the page does; return status and text."""
        sent = {"Origin": ORIGIN, "X-CSRF-Token": csrf, **headers}
        reply = self.client.post(path, json=body, headers=sent)
        return reply.status_code, reply.text


def bench(folder: Path, site: PageAddress | None = None) -> Bench:
    """Return a page of `folder/runs`, with the accounts of `folder/accounts.json`."""
    clock = Clock()
    runs = folder / "runs"
    # the poller that *Now* makes for itself is the test's: it looks when the test says so
    made: list[Live] = []

    def live(runs_dir: Path, started: Callable[[], dict[str, Any] | None]) -> Live:
        made.append(Live(runs_dir, started))
        return made[-1]

    with patch.object(now, "Live", live):
        screens = build_screens(Setting(runs, folder))
    frame = PageFrame(
        site or PageAddress.served("127.0.0.1", 8470, with_tls=False),
        Accounts(folder / "accounts.json", CHEAP),
        Sessions(clock),
        screens,
        Attempts(clock),
    )
    client = TestClient(build_app(frame), base_url=ORIGIN, follow_redirects=False)
    return Bench(frame, client, clock, made[0])
