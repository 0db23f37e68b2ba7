"""REST against its own description, by schemathesis: requests right and wrong that nobody chose."""

from __future__ import annotations

import asyncio
import os
import shutil
from pathlib import Path

import pytest
from brokers import free_port
from fake_plant import FakePlant, part_result
from wire_bench import eventually, is_listening

from controller.config.cell.connect import RestSection
from controller.plant.wires.rest import RestWire

PROGRAM = os.environ.get("CELLCTL_SCHEMATHESIS", "") or shutil.which("schemathesis") or ""
CLIENT_WALL_S = 600.0
# An account that is guessed at has to wait (429), which is as described; a text of signs that
# cannot be printed fits the description, and is refused by name (422).
LEFT_OUT = "ignored_auth,positive_data_acceptance"


@pytest.mark.slow
@pytest.mark.timeout(2 * CLIENT_WALL_S)
@pytest.mark.skipif(not PROGRAM, reason="schemathesis (CELLCTL_SCHEMATHESIS)")
async def test_every_path_answers_as_described_whatever_is_asked() -> None:
    plant, port = FakePlant(), free_port()
    for part in (1, 2, 3):
        plant.finish(part_result(part))
    serving = asyncio.create_task(
        RestWire(RestSection(listen=f"127.0.0.1:{port}"), Path()).serve(plant)
    )
    await eventually(lambda: is_listening(port))
    at = f"http://127.0.0.1:{port}"
    process = await asyncio.create_subprocess_exec(
        PROGRAM, "run", f"{at}/openapi.json", "--url", at, "--auth", "mes:correct horse battery",
        "--exclude-checks", LEFT_OUT, "--max-examples", "25", "--seed", "7",
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip
    try:
        output, _ = await asyncio.wait_for(process.communicate(), CLIENT_WALL_S)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)
    said = output.decode(errors="replace")
    assert process.returncode == 0, said
    assert "Tested: 10" in said  # all there are
