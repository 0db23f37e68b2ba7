"""Sparkplug B over mosquitto, read by pysparkplug: a broker and a host that nobody here wrote.

pysparkplug needs an environment of its own, which `CELLCTL_PYSPARKPLUG` names by its Python:
``python -m venv sparkplug && sparkplug/bin/pip install pysparkplug``.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiomqtt", reason="the extra `mqtt` is not installed")

from brokers import Broker, broker, missing
from fake_plant import FakePlant, alarm_notice, part_result
from wire_bench import deliver_surely, eventually, served

from controller.config.cell.mqtt import MqttSection
from controller.plant.wires.mqtt import SparkplugWire, mqtt_wires

PYTHON = os.environ.get("CELLCTL_PYSPARKPLUG", "")
MISSING = missing() or ("" if PYTHON else "CELLCTL_PYSPARKPLUG names no Python with pysparkplug")
pytestmark = pytest.mark.skipif(bool(MISSING), reason=MISSING or "all is here")


class Stranger:
    """The host, with what it has read so far."""

    def __init__(self, at: Broker) -> None:
        self._file = at.folder / "stranger.txt"
        with self._file.open("wb") as output:
            self._process = subprocess.Popen(
                [PYTHON, Path(__file__).with_name("sparkplug_stranger.py"), str(at.port)],
                stdin=subprocess.PIPE,
                stdout=output,
            )

    @property
    def read(self) -> list[dict[str, Any]]:
        lines = self._file.read_text().splitlines(keepends=True)
        return [json.loads(line) for line in lines if line.endswith("\n")]

    @property
    def data(self) -> list[dict[str, Any]]:
        return [one for one in self.read if one["kind"] == "DDATA"]

    def kinds(self) -> list[str]:
        return [one["kind"] for one in self.read]

    def ask_for_rebirth(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(b"rebirth plant cell-3\n")
        self._process.stdin.flush()

    def end(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.kill()
        self._process.wait()


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Broker]:
    with broker(tmp_path) as one:
        yield one


@pytest.fixture
async def stranger(at: Broker) -> AsyncIterator[Stranger]:
    one = Stranger(at)
    await eventually(lambda: "Sending SUBACK to sparkplug-stranger" in at.log)
    yield one
    one.end()


def wire(at: Broker, version: Any = 5, **sparkplug: Any) -> SparkplugWire:
    section = MqttSection(
        broker="127.0.0.1", port=at.port, version=version, sparkplug={"group": "plant", **sparkplug}
    )
    (found,) = (one for one in mqtt_wires(section, at.folder) if isinstance(one, SparkplugWire))
    return found


def tell_host(at: Broker, *, is_online: bool, at_ms: int) -> None:
    text = json.dumps({"online": is_online, "timestamp": at_ms})
    subprocess.run(
        ["mosquitto_pub", "-h", "127.0.0.1", "-p", str(at.port), "-q", "1", "-r",
         "-t", "spBv1.0/STATE/scada", "-m", text], check=True, timeout=60)  # fmt: skip


def in_sequence(read: list[dict[str, Any]]) -> bool:
    """Whether each message's number is one more than the last, from zero at each birth."""
    expected = 0
    for one in read:
        if one["kind"] in ("NDEATH", "NCMD"):
            continue
        if one["kind"] == "NBIRTH":
            expected = 0
        if one["seq"] != expected:
            return False
        expected = (expected + 1) % 256
    return True


@pytest.mark.parametrize("version", [5, "3.1.1"])
async def test_births_data_and_death_are_read_by_a_stranger(
    at: Broker, stranger: Stranger, version: Any
) -> None:
    plant, courier = FakePlant(), wire(at, version)
    result = plant.finish(part_result(7))
    async with served(courier, plant):
        await deliver_surely(courier, result)
        await deliver_surely(courier, alarm_notice())
        await plant.become(state="execute_presenting", counts={"accept": 3}, is_ready=False)
        await eventually(lambda: any("Counts/Accept" in one["metrics"] for one in stranger.data))
    await eventually(lambda: stranger.kinds()[-1:] == ["NDEATH"])
    read = stranger.read
    assert [one["kind"] for one in read] == [
        *("NBIRTH", "DBIRTH", "DDATA", "DDATA", "DDATA", "NDEATH")
    ]
    assert in_sequence(read)
    nbirth, dbirth, part, alarm, state, death = read
    assert nbirth["metrics"] == {"bdSeq": 0, "Node Control/Rebirth": False}
    assert (dbirth["metrics"]["State"], dbirth["metrics"]["Part/Json"]) == ("free", None)
    assert (part["metrics"]["Part/Serial"], part["historical"]) == ("SN-0007", False)
    told = json.loads(part["metrics"]["Part/Json"])
    assert told == json.loads(result.model_dump_json(by_alias=True))
    assert alarm["metrics"]["Alarm/Number"] == 201
    assert state["metrics"] == {
        **{"State": "execute_presenting", "Counts/Accept": 3, "Ready": False}
    }
    assert death["metrics"] == {"bdSeq": 0}
    assert not any(one["retain"] for one in read)


async def test_a_rebirth_that_a_stranger_asks_for_tells_everything_again(
    at: Broker, stranger: Stranger
) -> None:
    plant, courier = FakePlant(), wire(at)
    async with served(courier, plant):
        await deliver_surely(courier, part_result(1))
        await eventually(lambda: "DDATA" in stranger.kinds())
        stranger.ask_for_rebirth()
        await eventually(lambda: stranger.kinds().count("DBIRTH") == 2)
        await plant.become(message="after")
        await eventually(lambda: stranger.kinds()[-1] == "DDATA")
    born = [one for one in stranger.read if one["kind"] in ("NBIRTH", "DBIRTH")]
    assert [one["seq"] for one in born] == [0, 1, 0, 1]
    assert {one["metrics"]["bdSeq"] for one in born if one["kind"] == "NBIRTH"} == {0}
    assert born[-1]["metrics"]["Part/Serial"] == "SN-0001"
    assert in_sequence(stranger.read)


async def test_a_flood_of_rebirths_is_answered_by_a_few_and_data_go_on(
    at: Broker, stranger: Stranger
) -> None:
    plant, courier = FakePlant(), wire(at)
    async with served(courier, plant):
        await eventually(lambda: "DBIRTH" in stranger.kinds())
        for _ in range(500):
            stranger.ask_for_rebirth()
        await eventually(lambda: stranger.kinds().count("NCMD") == 500)
        await plant.become(message="after")
        await eventually(lambda: any("after" in str(one["metrics"]) for one in stranger.read))
    assert 2 <= stranger.kinds().count("NBIRTH") < 100
    assert in_sequence(stranger.read)


async def test_each_connection_has_the_next_bdseq_and_the_will_of_the_last_one(
    at: Broker, stranger: Stranger
) -> None:
    courier = wire(at)
    async with served(courier, FakePlant()):
        await eventually(lambda: "DBIRTH" in stranger.kinds())
        at.end(signal.SIGTERM)
        at.start()
        await eventually(lambda: at.log.count("Sending SUBACK to sparkplug-stranger") == 2)
        await eventually(lambda: at.log.count("Sending SUBACK to cellctl-cell-3-sparkplug") >= 2)
        stranger.ask_for_rebirth()  # the births came before the host was back: QoS 0
        await eventually(lambda: stranger.kinds().count("DBIRTH") >= 2)
    await eventually(lambda: stranger.kinds()[-1] == "NDEATH")
    births = [one["metrics"]["bdSeq"] for one in stranger.read if one["kind"] == "NBIRTH"]
    deaths = [one["metrics"]["bdSeq"] for one in stranger.read if one["kind"] == "NDEATH"]
    assert births[0] == 0
    assert births == sorted(births)
    assert deaths[-1] == births[-1] > 0


async def test_the_node_waits_for_its_primary_host_and_leaves_with_it(
    at: Broker, stranger: Stranger
) -> None:
    plant, courier = FakePlant(), wire(at, primary_host="scada")
    async with served(courier, plant):
        await eventually(lambda: "spBv1.0/STATE/scada" in at.log)
        tell_host(at, is_online=False, at_ms=1000)
        tell_host(at, is_online=True, at_ms=2000)
        await eventually(lambda: "DBIRTH" in stranger.kinds())
        tell_host(at, is_online=False, at_ms=1500)  # an old host's death, which came late
        await plant.become(message="still here")
        await eventually(lambda: stranger.kinds()[-1] == "DDATA")
        tell_host(at, is_online=False, at_ms=2000)
        await eventually(lambda: stranger.kinds()[-1] == "NDEATH")
        await plant.become(message="unheard")
        await deliver_later(courier, at, stranger)


async def deliver_later(courier: SparkplugWire, at: Broker, stranger: Stranger) -> None:
    """What comes while the host is away is told when it is back, with a new bdSeq."""
    delivery = asyncio.create_task(deliver_surely(courier, part_result(9)))
    tell_host(at, is_online=True, at_ms=3000)
    await delivery
    await eventually(lambda: stranger.kinds()[-1] == "DDATA")
    births = [one for one in stranger.read if one["kind"] in ("NBIRTH", "DBIRTH")]
    assert births[2]["metrics"]["bdSeq"] > births[0]["metrics"]["bdSeq"]
    assert births[3]["metrics"]["Message"] == "unheard"
    assert stranger.read[-1]["metrics"]["Part/Serial"] == "SN-0009"


async def test_results_that_others_follow_are_historical(at: Broker, stranger: Stranger) -> None:
    plant, courier = FakePlant(), wire(at)
    for part in (1, 2, 3):
        plant.finish(part_result(part))
    async with served(courier, plant):
        for part in (1, 2, 3):
            await deliver_surely(courier, part_result(part))
        await eventually(lambda: stranger.kinds().count("DDATA") >= 3)
    data = [one for one in stranger.data if "Part/Number" in one["metrics"]]
    assert [(one["metrics"]["Part/Number"], one["historical"]) for one in data] == [
        (1, True), (2, True), (3, False),
    ]  # fmt: skip
