"""The emulator's control port takes long scripts, and answers a line that is too long."""

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from emulators.control_port import LINE_BYTES, ControlPort


class Verbs:
    """Counts the steps of the scripts it is given."""

    def obey(self, line: bytes) -> dict[str, Any]:
        return {"ok": True, "steps": len(json.loads(line)["steps"])}


async def answers(path: Path, *lines: bytes) -> list[dict[str, Any]]:
    """Return what the port answers to lines that come one after the other."""
    port = ControlPort(Verbs(), path)  # type: ignore[arg-type]  # what the port uses of it
    await port.start()
    try:
        reader, writer = await asyncio.open_unix_connection(path)
        found = []
        for line in lines:
            writer.write(line)
            found.append(dict(json.loads(await reader.readline())))
        writer.close()
        return found
    finally:
        await port.aclose()


def script(step_count: int) -> bytes:
    step = {"do": "byte", "harm": "flipped", "device": "arm", "at_s": [1000.123, 2000.456]}
    return json.dumps({"do": "script", "seed": 1, "steps": [step] * step_count}).encode() + b"\n"


async def test_a_script_of_the_most_steps_is_taken(tmp_path: Path) -> None:
    (answer,) = await answers(tmp_path / "port", script(10_000))
    assert answer == {"ok": True, "steps": 10_000}


async def test_a_longer_line_is_refused_and_the_next_one_taken(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    lines = (b" " * length + b"\n" for length in (LINE_BYTES + 1, 3 * LINE_BYTES))
    first, second, third = await answers(tmp_path / "port", *lines, script(1))
    assert (first["ok"], second["ok"]) == (False, False)
    assert "4 MiB" in first["error"]
    assert third == {"ok": True, "steps": 1}
    assert caplog.records == []  # no traceback either
