"""MQTT in plain JSON, against mosquitto and its clients: strangers on both sides of the wire."""

from __future__ import annotations

import asyncio
import gc
import json
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiomqtt", reason="the extra `mqtt` is not installed")

from brokers import Broker, Listener, broker, missing
from fake_plant import FakePlant, alarm_notice, part_result
from wire_bench import deliver_surely, eventually, heard, served

from controller.config.cell.connect import ConnectSection
from controller.config.cell.mqtt import MqttSection
from controller.plant.assembly import wires_of
from controller.plant.plant import PlantError, RejectedError
from controller.plant.wires.mqtt import MqttWire

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing() or "mosquitto is here")

ROOT = Path(__file__).resolve().parents[2]
PREFIX = "cellctl/v1/cell-3"


@pytest.fixture
def listeners() -> Iterator[list[Listener]]:
    made: list[Listener] = []
    yield made
    for one in made:
        one.end()


@pytest.fixture
def open_broker(tmp_path: Path) -> Iterator[Broker]:
    with broker(tmp_path) as one:
        yield one


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Broker]:
    """A broker that asks for user and password; this cell's file is beside it."""
    passwords = tmp_path / "passwords"
    for user, word in (("cell-3", "tray-17"), ("mes", "mes-5")):
        known = ["-c"] if not passwords.exists() else []
        subprocess.run(["mosquitto_passwd", "-b", *known, passwords, user, word], check=True)
    secret = tmp_path / "secret"
    secret.write_text("tray-17\n")
    secret.chmod(0o600)
    with broker(tmp_path, "allow_anonymous false", f"password_file {passwords}") as one:
        yield one


def wire(at: Broker, **settings: Any) -> MqttWire:
    section = MqttSection(broker="127.0.0.1", port=at.port, **settings)
    return MqttWire(section, at.folder)


def known_wire(at: Broker, **settings: Any) -> MqttWire:
    return wire(at, user="cell-3", password_file="secret", **settings)


MES = ("-u", "mes", "-P", "mes-5")


def publish(at: Broker, topic: str, text: str | bytes, *more: str) -> None:
    subprocess.run(
        [
            "mosquitto_pub",
            "-h",
            "127.0.0.1",
            "-p",
            str(at.port),
            "-t",
            topic,
            "-s",
            "-q",
            "1",
            *more,
        ],
        input=text.encode() if isinstance(text, str) else text,
        check=True,
        timeout=60,
    )


def body(line: str) -> dict[str, Any]:
    found = json.loads(line.split(" ", 1)[1])
    assert isinstance(found, dict)
    return found


async def test_every_part_arrives_although_the_broker_is_killed_twice(
    open_broker: Broker, listeners: list[Listener]
) -> None:
    listener = Listener(open_broker, f"{PREFIX}/part")
    listeners.append(listener)
    await eventually(lambda: "Sending SUBACK to listener" in open_broker.log)
    courier = wire(open_broker)
    count = 60
    async with served(courier, FakePlant()):
        for part in range(1, count + 1):
            await deliver_surely(courier, part_result(part))
            if part in (20, 40):
                await heard(listener, f'"part":{part},')
                open_broker.save()
                open_broker.end(signal.SIGKILL)
                asyncio.get_running_loop().call_later(0.5, open_broker.start)
        await heard(listener, f'"part":{count},')
    parts = [body(line)["part"] for line in listener.lines]
    assert set(parts) == set(range(1, count + 1))
    firsts = list(dict.fromkeys(parts))
    assert firsts == sorted(firsts)


async def test_the_client_of_the_page_prints_each_part(guarded: Broker) -> None:
    page = (ROOT / "docs" / "plant-mqtt.md").read_text(encoding="utf-8")
    program = page.split("```python\n")[1].split("```")[0]
    changes = {
        'client.tls_set("plant-ca.pem")\n': "",
        '"mqtt.plant.example", 8883': f'"127.0.0.1", {guarded.port}',
        '"SECRET"': '"mes-5"',
    }
    for old, new in changes.items():
        assert program.count(old) == 1, old
        program = program.replace(old, new)
    courier = known_wire(guarded)
    client = await asyncio.create_subprocess_exec(
        *(sys.executable, "-u", "-c", program), stdout=asyncio.subprocess.PIPE
    )
    try:
        await eventually(lambda: "Sending SUBACK to mes" in guarded.log)
        async with served(courier, FakePlant()), asyncio.timeout(60):
            await deliver_surely(courier, part_result(5))
            assert client.stdout is not None
            assert await client.stdout.readline() == b"SN-0005 pass accept\n"
    finally:
        client.kill()
        await client.wait()


async def test_topics_have_the_payloads_of_the_model_and_state_is_retained(
    open_broker: Broker, listeners: list[Listener]
) -> None:
    plant, courier = FakePlant(), wire(open_broker)
    async with served(courier, plant):
        await deliver_surely(courier, part_result(7))
        await deliver_surely(courier, alarm_notice())
        await plant.become(state="execute_presenting", packml="Execute", run="R1", part=8)
        late = Listener(open_broker, f"{PREFIX}/#")
        listeners.append(late)
        state = body(await heard(late, f"{PREFIX}/state ", '"Execute"'))
        last = body(await heard(late, f"{PREFIX}/part/last "))
        await deliver_surely(courier, alarm_notice(501))
        alarm = body(await heard(late, f"{PREFIX}/alarm ", '"seq":501'))
    assert (state["schema"], state["online"], state["run"]) == ("cellctl.state/1", True, "R1")
    assert last == json.loads(part_result(7).model_dump_json(by_alias=True))
    assert (alarm["schema"], alarm["number"]) == ("cellctl.alarm/1", 201)
    assert not [line for line in late.lines if line.startswith(f"{PREFIX}/part ")]  # not retained


@pytest.mark.parametrize("version", [5, "3.1.1"])
async def test_a_planned_end_leaves_the_cell_offline(
    open_broker: Broker, listeners: list[Listener], version: Any
) -> None:
    listener = Listener(open_broker, f"{PREFIX}/state")
    listeners.append(listener)
    async with served(wire(open_broker, version=version), FakePlant()):
        await heard(listener, '"online":true')
    gone = body(await heard(listener, '"online":false'))
    assert (gone["schema"], gone["state"]) == ("cellctl.state/1", "unknown")


@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGSTOP])
async def test_the_will_comes_within_one_and_a_half_keep_alives_of_a_bridge_that_died_or_stands(
    open_broker: Broker, listeners: list[Listener], by: signal.Signals
) -> None:
    keep_alive_s = 5
    listener = Listener(open_broker, f"{PREFIX}/state")
    listeners.append(listener)
    program = Path(__file__).with_name("wire_process.py")
    bridge = subprocess.Popen(  # noqa: ASYNC220 - it ends by a signal, not by itself
        [sys.executable, program, str(open_broker.port), str(keep_alive_s)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    try:
        await heard(listener, '"online":true')
        loop = asyncio.get_running_loop()
        bridge.send_signal(by)
        since = loop.time()
        await heard(listener, '"online":false')
        # mosquitto looks once in five seconds whom it has not heard
        assert loop.time() - since < 1.5 * keep_alive_s + 5.0
    finally:
        bridge.kill()
        bridge.wait()


async def test_a_wrong_password_is_refused_in_a_sentence(guarded: Broker) -> None:
    (guarded.folder / "secret").write_text("tray-18")
    with pytest.raises(ConnectionError, match=r"(?i)not authori[sz]ed"):
        await known_wire(guarded).serve(FakePlant())


async def test_a_password_that_others_may_read_is_not_used(guarded: Broker) -> None:
    (guarded.folder / "secret").chmod(0o644)
    with pytest.raises(OSError, match="chmod 600"):
        await known_wire(guarded).serve(FakePlant())


def test_a_password_is_not_sent_in_clear_to_another_machine() -> None:
    with pytest.raises(ValueError, match="readable on the way"):
        MqttSection(broker="mqtt.plant.example", user="cell-3", password_file="secret")
    MqttSection(broker="mqtt.plant.example", user="cell-3", password_file="s", tls={})
    MqttSection(broker="mqtt.plant.example", user="cell-3", password_file="s", clear_text=True)


async def taking_orders(at: Broker) -> None:
    await eventually(lambda: "Sending SUBACK to cellctl-cell-3" in at.log)


async def request(at: Broker, text: str, reply_to: str, *more: str) -> str:
    """Ask as `mosquitto_rr` does: with a response topic and correlation data of MQTT 5."""
    asking = await asyncio.create_subprocess_exec(
        *("mosquitto_rr", "-h", "127.0.0.1", "-p", str(at.port), "-V", "5", *MES, "-q", "1"),
        *("-t", f"{PREFIX}/cmd/order", "-e", reply_to, "-m", text, "-W", "60", *more),
        stdout=asyncio.subprocess.PIPE,
    )
    output, _ = await asking.communicate()
    return output.decode()


async def test_an_order_is_answered_on_the_response_topic_with_its_correlation_data(
    guarded: Broker, listeners: list[Listener]
) -> None:
    plant = FakePlant()
    order = {"number": "PO-4711", "recipe": "holder", "serials": ["SN-1", "SN-2"]}
    own = f"{PREFIX}/cmd/order/reply/mes"
    retained = Listener(guarded, f"{PREFIX}/order", extra=MES)
    correlated = Listener(guarded, f"{own}/#", extra=(*MES, "-V", "5"), form="%t %D %p")
    listeners += [retained, correlated]
    async with served(known_wire(guarded, reply_to=["mes/answers"]), plant):
        await taking_orders(guarded)
        answer = json.loads(await request(guarded, json.dumps(order), own, *("-D", "publish",
            "correlation-data", "order-1")))  # fmt: skip
        again = json.loads(await request(guarded, json.dumps(order), "mes/answers/1"))
        await heard(retained, '"number":"PO-4711"')
        line = await heard(correlated, "PO-4711")
    assert (answer["state"], answer["quantity"], answer["source"]) == ("queued", 2, "MQTT")
    assert again == answer
    assert " order-1 " in line


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"number": "PO-1", "recipe": "nothing"}', "no recipe 'nothing'"),
        ('{"number": "PO-1", "recipe": "broken"}', "unknown key"),
        ('{"number": "", "recipe": "holder"}', "number"),
        ('{"recipe": "holder"}', "number"),
        ('{"number": "PO-1", "recipe": "holder", "open_gripper": true}', "open_gripper"),
        ('{"number": "PO-1", "recipe": "holder", "quantity": 1e9}', "quantity"),
        ('[{"number": "PO-1"}]', "object"),
        ("{", "JSON"),
        ("[" * 5000, "JSON"),
        ('{"number": "PO-\\u0007", "recipe": "holder"}', "printed"),
    ],
)
async def test_what_is_no_order_is_refused_in_a_sentence(
    guarded: Broker, listeners: list[Listener], text: str, reason: str
) -> None:
    plant = FakePlant()
    replies = Listener(guarded, f"{PREFIX}/cmd/order/reply", extra=MES)
    listeners.append(replies)
    async with served(known_wire(guarded), plant):
        await taking_orders(guarded)
        publish(guarded, f"{PREFIX}/cmd/order", text, *MES)
        answer = body(await heard(replies, "refused"))
    assert reason in answer["reason"]
    assert all(order.state == "refused" for order in await plant.orders())


async def test_the_cell_cannot_be_made_to_write_to_another_topic(
    guarded: Broker, listeners: list[Listener]
) -> None:
    plant = FakePlant()
    all_topics = Listener(guarded, "#", extra=MES)
    listeners.append(all_topics)
    async with served(known_wire(guarded), plant):
        await taking_orders(guarded)
        for number, topic in enumerate(
            ("cellctl/v1/cell-4/cmd/order", "spBv1.0/g/NCMD/n", f"{PREFIX}/state", f"{PREFIX}/cmd")
        ):
            order = json.dumps({"number": f"PO-{number}", "recipe": "holder"})
            publish(guarded, f"{PREFIX}/cmd/order", order, *MES, "-V", "5",
                    "-D", "publish", "response-topic", topic)  # fmt: skip
            await heard(all_topics, f"{PREFIX}/cmd/order/reply ", f'"PO-{number}"')
        for line in all_topics.lines:
            assert line.startswith(f"{PREFIX}/")
            if not line.startswith(f"{PREFIX}/cmd/order"):
                assert "PO-" not in line or line.startswith(f"{PREFIX}/order ")


async def test_nothing_but_an_order_is_taken_in_and_no_order_that_was_retained(
    guarded: Broker, listeners: list[Listener]
) -> None:
    plant = FakePlant()
    order = json.dumps({"number": "PO-old", "recipe": "holder"})
    publish(guarded, f"{PREFIX}/cmd/order", order, *MES, "-r")
    replies = Listener(guarded, f"{PREFIX}/cmd/#", extra=MES)
    listeners.append(replies)
    async with served(known_wire(guarded, version="3.1.1"), plant):
        await taking_orders(guarded)
        for topic in ("cmd/stop", "cmd/abort", "cmd/gripper", "state", "cmd/order/x"):
            publish(guarded, f"{PREFIX}/{topic}", order, *MES)
        publish(guarded, "cellctl/v1/cell-4/cmd/order", order, *MES)
        publish(guarded, f"{PREFIX}/cmd/order", order.replace("old", "new"), *MES)
        await heard(replies, "cmd/order/reply ", "PO-new")
    assert plant.told == [("order", "PO-new", "MQTT")]


async def test_a_broker_that_lets_anybody_in_gives_no_orders(
    open_broker: Broker, listeners: list[Listener], caplog: pytest.LogCaptureFixture
) -> None:
    plant = FakePlant()
    states = Listener(open_broker, f"{PREFIX}/state")
    listeners.append(states)
    async with served(wire(open_broker), plant):
        await heard(states, '"online":true')
        publish(open_broker, f"{PREFIX}/cmd/order", '{"number": "1", "recipe": "holder"}')
        await plant.become(message="later")
        await heard(states, "later")
    assert plant.told == []
    assert "lets anybody in" in caplog.text


async def test_a_flood_and_what_is_too_large_leave_the_wire_serving(
    guarded: Broker, listeners: list[Listener]
) -> None:
    plant, courier = FakePlant(), known_wire(guarded)
    states = Listener(guarded, f"{PREFIX}/state", extra=MES)
    listeners.append(states)
    async with served(courier, plant) as errors:
        await taking_orders(guarded)
        publish(guarded, f"{PREFIX}/cmd/order", b"x" * 5_000_000, *MES)
        flood = "".join(f'{{"number": "F{n}", "recipe": "nothing"}}\n' for n in range(3000))
        pouring = await asyncio.create_subprocess_exec(
            *("mosquitto_pub", "-h", "127.0.0.1", "-p", str(guarded.port), *MES, "-q", "1"),
            *("-l", "-t", f"{PREFIX}/cmd/order"),
            stdin=asyncio.subprocess.PIPE,
        )
        assert pouring.stdin is not None
        pouring.stdin.write(flood.encode())
        pouring.stdin.close()
        await deliver_surely(courier, part_result(1))
        await pouring.wait()
        await plant.become(message="after the flood")
        await heard(states, "after the flood")
        assert errors == []


async def test_a_message_that_the_broker_does_not_allow_does_not_count_as_delivered(
    guarded: Broker, listeners: list[Listener]
) -> None:
    allowed = guarded.folder / "allowed"
    allowed.write_text(f"user cell-3\ntopic readwrite {PREFIX}/state\ntopic read {PREFIX}/cmd/#\n")
    guarded.end()
    guarded.lines = (*guarded.lines, f"acl_file {allowed}")
    guarded.start()
    courier = known_wire(guarded)
    async with served(courier, FakePlant()):
        await taking_orders(guarded)
        with pytest.raises(OSError, match=r"(?i)does not take .*/part: not authorized"):
            await courier.deliver(part_result(1))


async def test_a_state_that_the_broker_does_not_allow_hinders_no_result(
    guarded: Broker, caplog: pytest.LogCaptureFixture
) -> None:
    allowed = guarded.folder / "allowed"
    allowed.write_text(f"user cell-3\ntopic write {PREFIX}/part/#\ntopic write {PREFIX}/part\n")
    guarded.end()
    guarded.lines = (*guarded.lines, f"acl_file {allowed}")
    guarded.start()
    plant, courier = FakePlant(), known_wire(guarded)
    async with served(courier, plant) as errors:
        await eventually(lambda: "does not take cellctl/v1/cell-3/state" in caplog.text)
        await courier.deliver(part_result(1))
        assert errors == []


@pytest.mark.parametrize("version", [5, "3.1.1"])
async def test_a_cell_that_may_not_read_orders_still_tells_its_results(
    guarded: Broker, listeners: list[Listener], version: Any
) -> None:
    allowed = guarded.folder / "allowed"
    allowed.write_text(f"user cell-3\ntopic write {PREFIX}/#\nuser mes\ntopic readwrite #\n")
    guarded.end()
    guarded.lines = (*guarded.lines, f"acl_file {allowed}")
    guarded.start()
    plant, courier = FakePlant(), known_wire(guarded, version=version)
    heard_parts = Listener(guarded, f"{PREFIX}/part", extra=MES)
    listeners.append(heard_parts)
    await eventually(lambda: "Sending SUBACK to listener" in guarded.log)
    async with served(courier, plant) as errors:
        await deliver_surely(courier, part_result(1))
        await heard(heard_parts, '"part":1,')
        publish(guarded, f"{PREFIX}/cmd/order", '{"number": "1", "recipe": "holder"}', *MES)
        assert errors == []
    assert plant.told == []


@pytest.mark.parametrize("version", [5, "3.1.1"])
async def test_a_part_that_the_broker_cuts_off_for_is_put_aside_in_the_end(
    tmp_path: Path, version: Any
) -> None:
    with broker(tmp_path, "allow_anonymous true", "max_packet_size 20000") as small:
        courier = wire(small, version=version)
        async with served(courier, FakePlant()):
            await deliver_surely(courier, part_result(1))
            with pytest.raises(RejectedError, match="max_packet_size"):
                await deliver_surely(courier, part_result(2, reasons=("r" * 30_000,)))
            await deliver_surely(courier, part_result(3))


async def test_a_connection_that_is_lost_leaves_nothing_behind(open_broker: Broker) -> None:
    unasked: list[str] = []
    asyncio.get_running_loop().set_exception_handler(
        lambda _loop, context: unasked.append(str(context))
    )
    courier = wire(open_broker)
    async with served(courier, FakePlant()) as errors:
        await deliver_surely(courier, part_result(1))
        os.kill(open_broker.pid, signal.SIGSTOP)  # so that the next one waits for its PUBACK
        delivery = asyncio.create_task(courier.deliver(part_result(2)))
        await asyncio.sleep(0)
        open_broker.end()
        with pytest.raises(OSError, match="connect"):
            await delivery
        await eventually(lambda: bool(errors))
    before = {task for task in asyncio.all_tasks() if task is not asyncio.current_task()}
    gc.collect()
    await asyncio.sleep(0)
    assert before == set()
    assert unasked == []


def test_a_missing_package_is_told_with_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in [name for name in sys.modules if name.startswith("controller.plant.wires.mqtt")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "aiomqtt", None)
    connect = ConnectSection.model_validate({"mqtt": {"broker": "127.0.0.1"}})
    with pytest.raises(PlantError, match=r"aiomqtt: pip install 'cellctl\[mqtt\]'"):
        wires_of(connect, tmp_path)


def _certificates(folder: Path) -> None:
    """Write two authorities, and from the first a broker's certificate and a cell's."""
    new = ("openssl", "req", "-newkey", "rsa:2048", "-nodes")
    for name in ("ca", "other-ca"):
        subprocess.run(
            [*new, "-x509", "-days", "2", "-subj", f"/CN={name}", "-keyout", folder / f"{name}.key",
             "-out", folder / f"{name}.pem"], check=True, capture_output=True)  # fmt: skip
    for name, by in (("broker", "ca"), ("cell-3", "ca"), ("stranger", "other-ca")):
        subprocess.run(
            [*new, "-subj", f"/CN={name}", "-keyout", folder / f"{name}.key",
             "-out", folder / f"{name}.csr"], check=True, capture_output=True)  # fmt: skip
        (folder / "names").write_text("subjectAltName=IP:127.0.0.1\n")
        subprocess.run(
            ["openssl", "x509", "-req", "-days", "2", "-in", folder / f"{name}.csr", "-CA",
             folder / f"{by}.pem", "-CAkey", folder / f"{by}.key", "-CAcreateserial", "-extfile",
             folder / "names", "-out", folder / f"{name}.pem"],
            check=True, capture_output=True)  # fmt: skip
        (folder / f"{name}.key").chmod(0o600)


@pytest.fixture
async def sealed(tmp_path: Path) -> AsyncIterator[Broker]:
    """A broker that speaks TLS alone and asks for a certificate."""
    _certificates(tmp_path)
    lines = (
        f"cafile {tmp_path}/ca.pem",
        f"certfile {tmp_path}/broker.pem",
        f"keyfile {tmp_path}/broker.key",
        "require_certificate true",
        "use_identity_as_username true",
    )
    with broker(tmp_path, *lines) as one:
        yield one


async def test_a_certificate_of_this_cell_lets_it_in(sealed: Broker) -> None:
    tls = {"ca": "ca.pem", "certificate": "cell-3.pem", "key": "cell-3.key"}
    courier = wire(sealed, tls=tls)
    async with served(courier, FakePlant()) as errors:
        await deliver_surely(courier, part_result(1))
        assert errors == []


# paho leaves a socket to the collector when TLS does not come about
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    "tls",
    [
        {"ca": "other-ca.pem", "certificate": "cell-3.pem", "key": "cell-3.key"},
        {"ca": "ca.pem", "certificate": "stranger.pem", "key": "stranger.key"},
        {"ca": "ca.pem"},
        None,
    ],
    ids=["a broker of another authority", "a stranger's certificate", "no certificate", "no TLS"],
)
async def test_no_other_gets_a_connection(sealed: Broker, tls: Any) -> None:
    with pytest.raises(OSError, match=r"certificate|TLS"):
        await wire(sealed, tls=tls).serve(FakePlant())
