"""The golden bytes are those that the protocol's page prints, each session in its section."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PAGES = HERE.parents[1] / "docs" / "protocols"
FRAME = re.compile(r"`([0-9A-F]{2}(?: [0-9A-F]{2})*)`")


def golden(name: str) -> dict[str, Any]:
    return tomllib.loads((HERE / f"{name}.toml").read_text(encoding="utf-8"))


def printed(text: str) -> set[str]:
    return set(FRAME.findall(text))


def section(page: str, number: str) -> str:
    found = re.search(rf"^### {re.escape(number)} .*?(?=^##|\Z)", page, re.MULTILINE | re.DOTALL)
    assert found is not None, number
    return found[0]


def test_every_modbus_frame_stands_on_its_page() -> None:
    page = printed((PAGES / "modbus_devices.md").read_text(encoding="utf-8"))
    frames = [
        f[way]
        for f in golden("modbus_devices")["frame"]
        for way in ("request", "reply")
        if way in f
    ]
    assert len(frames) > 90
    assert not [frame for frame in frames if frame.upper() not in page]


def test_every_frame_of_an_arm_session_stands_in_its_section() -> None:
    page = (PAGES / "umi_rtx.md").read_text(encoding="utf-8")
    missing, count = [], 0
    for session in golden("umi_rtx")["session"]:
        shown = printed(section(page, session["section"]))
        for exchange in session["exchange"]:
            for way in ("request", "reply"):
                count += 1
                if exchange[way].upper() not in shown:
                    missing.append((session["section"], way, exchange[way]))
    assert count > 250
    assert not missing


def test_every_frame_of_a_ur_session_stands_on_its_page() -> None:
    page = printed((PAGES / "universal_robots.md").read_text(encoding="utf-8"))
    frames = [
        frame
        for session in golden("universal_robots")["session"]
        for exchange in session["exchange"]
        for frame in exchange.values()
        if frame
    ] + [session["data"] for session in golden("universal_robots")["session"] if "data" in session]
    assert len(frames) > 30
    assert not [frame for frame in frames if frame not in page]


def test_every_frame_of_gige_vision_stands_on_its_page() -> None:
    page = printed((PAGES / "gige_vision.md").read_text(encoding="utf-8"))
    frames = golden("gige_vision")
    said = [f[way] for f in frames["request"] for way in ("frame", "reply") if way in f]
    said += [f["frame"] for f in frames["stream"]]
    assert len(said) > 8
    assert not [frame for frame in said if frame not in page]
