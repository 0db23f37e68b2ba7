"""Clients in processes of their own that share nothing with the server: node-opcua, the manual's.

node-opcua runs where Node has it: `npm install node-opcua-client`, and NODE_PATH names its folder
`node_modules`. The other is the program of docs/plant-opcua.md, word for word but for its address:
it knows no type of OPC 40100-1 but from the server.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from fake_plant import idle_state, part_result
from opcua_bench import PASSWORD, RUN, Bench

from controller.config.cell.connect import ConnectSection, OpcuaSection
from controller.plant.assembly import wires_of
from controller.plant.plant import PlantError

HERE = Path(__file__).parent
MANUAL = HERE.parents[1] / "docs" / "plant-opcua.md"
CLIENT_WALL_S = 300.0
BRIDGE_MAX_MB = 150


def has_node_opcua() -> bool:
    """Return whether Node is here and finds node-opcua-client."""
    if (node := shutil.which("node")) is None:
        return False
    found = subprocess.run(
        [node, "-e", "require.resolve('node-opcua-client')"], capture_output=True, check=False
    )
    return found.returncode == 0


needs_node = pytest.mark.skipif(
    not has_node_opcua(), reason="Node with node-opcua-client (NODE_PATH)"
)


async def ordered(bench: Bench) -> str:
    """Wait for an order and return its number."""
    async with asyncio.timeout(CLIENT_WALL_S):
        while not (orders := await bench.plant.orders()):  # noqa: ASYNC110 - in the client's time
            await asyncio.sleep(0.05)
    return orders[0].number


async def ended(process: asyncio.subprocess.Process) -> tuple[str, str]:
    """Return what a client printed; end it where it does not end."""
    try:
        out, error = await asyncio.wait_for(process.communicate(), CLIENT_WALL_S)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return out.decode(), error.decode()


@needs_node
async def test_node_opcua_orders_a_part_and_reads_its_result(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    async with bench.serving():
        client = await asyncio.create_subprocess_exec(
            "node", HERE / "opcua_stranger.js", bench.wire.url, *bench.trusted, tmp_path / "node",
            "mes", PASSWORD, "holder", "SN-1",
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        reading = asyncio.create_task(ended(client))
        working = asyncio.create_task(ordered(bench))
        await asyncio.wait({reading, working}, return_when=asyncio.FIRST_COMPLETED)
        assert working.done(), reading.result()
        number = working.result()
        bench.plant.change_order(number, state="running")
        await bench.run(number)
        result = bench.plant.finish(part_result(1, order=number, serial="SN-1"))
        await bench.wire.deliver(result)
        out, error = await reading
    steps: dict[str, Any] = {}
    events = []
    for line in out.splitlines():
        if line.startswith('{"step"'):
            said = json.loads(line)
            steps[said["step"]] = said["value"]
            events += [said["value"]] if said["step"] == "event" else []
    assert client.returncode == 0, error
    assert "BadUserAccessDenied" in steps["wrong password"]
    assert "let in" not in (steps["anonymous"], steps["policy None"])
    assert steps["recipes"] == ["holder", "plate", "broken"]
    assert steps["prepared"] == ["holder", True, 0]
    assert steps["job"] == ["PO-SN-1", 0]
    assert steps["state"] == "SingleExecution"
    assert steps["write"] == "BadUserAccessDenied"
    assert "BadUserAccessDenied" in steps["add nodes"]
    own = json.loads(result.model_dump_json(by_alias=True))
    ready = steps["result ready"]
    assert (ready["id"], ready["verdict"], ready["state"]) == (f"{RUN}/1/1", "pass", 1)
    assert (ready["serial"], ready["json"]) == ("SN-1", own)
    found = steps["result"]
    assert (found["serial"], found["job"], found["error"]) == ("SN-1", "PO-SN-1", 0)
    assert found["json"] == own
    assert events[:2] == ["holder is prepared", "Initialized to Ready"]


async def test_the_client_of_the_manual_starts_a_job(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    program = re.findall(r"```python\n(.*?)```", MANUAL.read_text(encoding="utf-8"), re.DOTALL)[0]
    async with bench.serving():
        for before, after in (
            ("opc.tcp://127.0.0.1:4840/cellctl", bench.wire.url),
            ("urn:mes", "urn:test:mes"),
            ('"mes.der"', repr(str(bench.trusted[0]))),
            ('"mes.pem"', repr(str(bench.trusted[1]))),
            ('"connect/opcua/', f'"{bench.folder}/'),
            ("SECRET", PASSWORD),
        ):
            assert before in program
            program = program.replace(before, after)
        client = await asyncio.create_subprocess_exec(
            sys.executable, "-c", program,
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        out, error = await ended(client)
        assert client.returncode == 0, error
        order = (await bench.plant.orders())[0]
    assert f"JobIdDataType(Id='{order.number}'), 0]" in out
    assert order.request.serials == ("SN-1",)


async def test_a_job_of_another_life_of_the_server_is_gone_on_with(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    async with bench.serving():
        vision = bench.wire._vision
        assert vision is not None
        await vision.prepare_recipe(bench.plant.offers[0])
        await vision.start("single", "mes", "PO-1", "", "SN-1", 1)
        bench.plant.change_order("PO-1", state="running")
        await bench.run("PO-1")
        assert vision.vision_state == "SingleExecution"
    bench.wire.url = ""
    result = bench.plant.finish(part_result(1, order="PO-1", serial="SN-1"))
    with pytest.raises(ConnectionError):
        await bench.wire.deliver(result)
    async with bench.serving():
        vision = bench.wire._vision
        assert vision is not None
        assert vision.vision_state == "SingleExecution"
        await bench.wire.deliver(result)
        await vision.order_changed(bench.plant.change_order("PO-1", state="done"))
        await bench.become(idle_state())
        assert vision.vision_state == "Ready"


def test_a_package_that_is_missing_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("controller.plant.wires.opcua")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "asyncua", None)
    with pytest.raises(PlantError, match=r"asyncua: pip install 'cellctl\[opcua\]'"):
        wires_of(ConnectSection(opcua=OpcuaSection()), tmp_path)


def test_the_bridge_with_a_server_takes_no_more_memory_than_it_may(tmp_path: Path) -> None:
    program = """
import asyncio, sys
import controller.plant.assembly
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from opcua_bench import Bench
async def main():
    async with Bench(Path(sys.argv[2])).serving():
        print(Path("/proc/self/status").read_text())
asyncio.run(main())
"""
    done = subprocess.run(
        [sys.executable, "-c", program, str(HERE), str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(HERE.parents[1])},
    )
    most_kb = re.search(r"VmHWM:\s+(\d+) kB", done.stdout)
    assert most_kb is not None
    assert int(most_kb[1]) / 1024 <= BRIDGE_MAX_MB
