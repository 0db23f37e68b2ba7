"""OPC UA and a whole emulated cell: one part ordered and read, whatever becomes of the bridge."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyAes256Sha256RsaPss
from opcua_bench import Vision, make_certificate

ROOT = Path(__file__).parents[2]
CELLCTL = (sys.executable, "-m", "controller.cli")
AUTOMATIC = "VisionStateMachine/AutomaticModeStateMachine"
RUN_WALL_S = 1200.0  # homing, 24 views and their verdict at ten times real time, on a busy machine
POLL_WALL_S = 0.5

pytestmark = pytest.mark.slow


class Site:
    """A folder with an emulated cell that a plant may start, and one client's certificate.

    Attributes
    ----------
    folder : working directory of the programs
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        text = (ROOT / "recipes" / "cells" / "emulated.yaml").read_text(encoding="utf-8")
        text += f'\nconnect:\n  may_start: "yes"\n  opcua: {{listen: "127.0.0.1:{self.port}"}}\n'
        (folder / "cell.yaml").write_text(text, encoding="utf-8")
        self.files = make_certificate(folder / "clients", "mes")
        trusted = folder / "connect" / "opcua" / "trusted"
        trusted.mkdir(parents=True)
        shutil.copy(self.files[0], trusted)
        self.environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "XDG_CONFIG_HOME": str(folder / "config"),
            "XDG_STATE_HOME": str(folder / "state"),
        }
        said = self.cellctl("account", "mes", "--role", "plant", "--generate")
        self.password = said.split("password ")[1].split()[0]

    def cellctl(self, *arguments: str) -> str:
        """Return what a command prints."""
        done = subprocess.run(
            [*CELLCTL, *arguments],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def status(self) -> dict[str, Any]:
        """Return the state of the cell."""
        found: dict[str, Any] = json.loads(self.cellctl("status", "--json").splitlines()[-1])
        return found

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[asyncio.subprocess.Process]:
        """Run the bridge within a block."""
        with (self.folder / "connect.log").open("ab") as log:
            bridge = await asyncio.create_subprocess_exec(
                *CELLCTL, "connect", "--cell", "cell.yaml", "--speed", "10", "--seed", "7",
                cwd=self.folder, env=self.environment, stdout=log, stderr=log,
            )  # fmt: skip
            try:
                yield bridge
            finally:
                if bridge.returncode is None:
                    bridge.send_signal(signal.SIGTERM)
                await bridge.wait()

    @asynccontextmanager
    async def vision(self) -> AsyncIterator[Vision]:
        """Let a client in within a block, as soon as the server is up."""
        async with asyncio.timeout(RUN_WALL_S):
            while True:
                client = Client(
                    f"opc.tcp://127.0.0.1:{self.port}/cellctl", timeout=60, watchdog_intervall=60
                )
                client.application_uri = "urn:test:mes"
                client.set_user("mes")
                client.set_password(self.password)
                try:
                    await client.set_security(SecurityPolicyAes256Sha256RsaPss, *self.files)
                    await client.connect()
                except OSError:
                    await asyncio.sleep(POLL_WALL_S)
                else:
                    break
        try:
            await client.load_data_type_definitions()
            yield await Vision.found(client)
        finally:
            await client.disconnect()


async def until(is_so: Callable[[], bool]) -> None:
    """Wait until something is so."""
    async with asyncio.timeout(RUN_WALL_S):
        while not await asyncio.to_thread(is_so):  # noqa: ASYNC110 - other processes
            await asyncio.sleep(POLL_WALL_S)


async def start(vision: Vision, serial: str) -> None:
    await vision.call(
        "RecipeManagement/PrepareRecipe", ua.RecipeIdExternalDataType(Id="holder"), None
    )
    job, error = await vision.call(
        f"{AUTOMATIC}/StartSingleJob",
        ua.MeasIdDataType(Id=f"PO-{serial}"), ua.PartIdDataType(Id=serial), None, None,
        ua.Variant([], ua.VariantType.Variant, is_array=True),
    )  # fmt: skip
    assert (job.Id, error) == (f"PO-{serial}", 0)
    assert await vision.state() == ("Operational", "SingleExecution")


async def test_a_part_is_ordered_and_read_though_the_bridge_is_killed_and_the_next_is_stopped(
    tmp_path: Path,
) -> None:
    site = Site(tmp_path)

    def is_working() -> bool:
        return str(site.status()["state"]).startswith("execute")

    def is_idle() -> bool:
        return site.status()["state"] in ("free", "left")

    async with site.connected() as bridge:
        async with site.vision() as vision:
            await start(vision, "SN-1")
            await until(is_working)
        bridge.kill()
        await bridge.wait()
        await until(is_idle)
    async with site.connected(), site.vision() as vision:
        found = await vision.call(
            "ResultManagement/GetResultListFiltered",
            ua.Variant(0, ua.VariantType.Int32), None, ua.PartIdDataType(Id="SN-1"),
            None, None, None, None, None, None,
            *(ua.Variant(0, ua.VariantType.UInt32),) * 2, ua.Variant(0, ua.VariantType.Int32),
        )  # fmt: skip
        assert [one.JobId.Id for one in found[3]] == ["PO-SN-1"]
        _, result, error = await vision.call(
            "ResultManagement/GetResultById",
            found[3][0].ResultId,
            ua.Variant(0, ua.VariantType.Int32),
        )
        assert error == 0
        assert result.IsSimulated
        own = json.loads(result.ResultContent[0].Value)
        run = result.ResultId.Id.split("/")[0]
        part = json.loads(site.cellctl("report", f"runs/{run}", "--format", "json"))["parts"][0]
        assert (own["serial"], own["verdict"]) == (part["serial"], part["verdict"])
        assert result.ResultContent[1].Value == part["verdict"]
        named = ("id", "nominal", "lower", "upper", "measured", "U", "verdict")
        assert [[one[name] for name in named] for one in own["characteristics"]] == [
            [one[name] for name in named] for one in part["characteristics"]
        ]
        assert own["characteristics"]

        await start(vision, "SN-2")
        await until(is_working)
        stopped = await vision.call(
            f"{AUTOMATIC}/Stop", ua.Variant(1, ua.VariantType.Int32), "the shift ends"
        )
        assert stopped == 0
        outer, inner = await vision.state()
        assert (outer, inner) in (("Operational", "Ready"), ("Error", None))
        await until(is_idle)
    rows = site.cellctl("orders", "--json")
    orders = {one["number"]: one for one in map(json.loads, rows.splitlines())}
    assert orders["PO-SN-1"]["state"] == "done"
    assert orders["PO-SN-2"]["state"] in ("stopped", "running")
    assert "mes by OPC UA" in {one["source"] for one in orders.values()}
