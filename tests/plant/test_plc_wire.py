"""Registers over Modbus TCP: a PLC made of `mbpoll`, one of pymodbus' client, and attacks."""

from __future__ import annotations

import asyncio
import contextlib
import random
import shutil
import struct
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from typing import Any

import pytest
from brokers import free_port
from fake_plant import FakePlant, alarm_notice, part_result
from pymodbus.client import AsyncModbusTcpClient
from wire_bench import deliver_surely, eventually, is_listening, served

from controller.config.cell.plc import PlcSection
from controller.plant.wires.plc import ModbusServer, PlcWire
from controller.plant.wires.plc.registers import CommandBit, FailureReason, Status

START, STOP, ACKNOWLEDGED = CommandBit.START, CommandBit.STOP, CommandBit.RESULT_ACKNOWLEDGED
RECIPES = {1: {"recipe": "holder", "values": ["d1"]}, 2: "plate", 3: "broken"}


@asynccontextmanager
async def worked(wire: PlcWire, plant: FakePlant) -> AsyncIterator[None]:
    """A cell that works off orders, and the outbox that delivers its results in order."""
    changes = plant.order_changes()
    results: asyncio.Queue[Any] = asyncio.Queue()
    count = 0

    async def work() -> None:
        nonlocal count
        async for order in changes:
            if order.state != "queued":
                continue
            plant.change_order(order.number, state="running")
            await plant.become(is_ready=False, packml="Execute", state="execute_presenting")
            serials = order.request.serials
            for place in range(order.quantity or 1):
                count += 1
                serial = serials[place] if serials else None
                results.put_nowait(
                    plant.finish(part_result(count, order=order.number, serial=serial))
                )
            await plant.become(is_ready=True, packml="Idle", state="free")
            plant.change_order(order.number, state="done")

    async def deliver() -> None:
        while True:
            await deliver_surely(wire, await results.get())

    tasks = [asyncio.create_task(work()), asyncio.create_task(deliver())]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def plc_wire(port: int, **settings: Any) -> PlcWire:
    section = {"listen": f"127.0.0.1:{port}", "recipes": RECIPES, **settings}
    return PlcWire(PlcSection.model_validate(section))


class Master:
    """A PLC's program, over whatever reads and writes registers."""

    def __init__(self) -> None:
        self.beats = 0

    async def read(self, address: int, count: int) -> list[int]:
        raise NotImplementedError

    async def write(self, address: int, values: Sequence[int]) -> None:
        raise NotImplementedError

    async def beat(self) -> None:
        self.beats = (self.beats + 1) % 0x10000
        await self.write(103, [self.beats])

    async def until(self, bit: Status, *, is_set: bool = True) -> Status:
        async with asyncio.timeout(90):
            while True:
                await self.beat()
                status = Status((await self.read(1, 1))[0])
                if bool(status & bit) == is_set:
                    return status

    async def start(self, recipe: int, serial: str = "", quantity: int = 1) -> Status:
        """Start, wait for an answer, drop the bit; return the answer."""
        text = serial.encode().ljust(32, b"\0")
        await self.write(101, [recipe, quantity])
        await self.write(104, struct.unpack(">16H", text))
        await self.write(100, [START])
        status = await self.until(Status.START_ACKNOWLEDGED | Status.COMMAND_FAILED)
        await self.write(100, [0])
        await self.until(Status.START_ACKNOWLEDGED | Status.COMMAND_FAILED, is_set=False)
        return status

    async def take_result(self) -> tuple[int, str, float]:
        """Return inspection number, serial and first value, and acknowledge."""
        await self.until(Status.RESULT_VALID)
        found = await self.read(6, 22)
        await self.write(100, [ACKNOWLEDGED])
        await self.until(Status.RESULT_VALID, is_set=False)
        await self.write(100, [0])
        text = struct.pack(">16H", *found[4:20]).rstrip(b"\0").decode()
        (value,) = struct.unpack(">f", struct.pack(">HH", *found[20:22]))
        return found[2] << 16 | found[3], text, value


class Pymodbus(Master):
    """The client of pymodbus."""

    def __init__(self, client: AsyncModbusTcpClient) -> None:
        super().__init__()
        self._client = client

    async def read(self, address: int, count: int) -> list[int]:
        found = await self._client.read_holding_registers(address, count=count)
        assert not found.isError(), found
        return found.registers

    async def write(self, address: int, values: Sequence[int]) -> None:
        reply = await self._client.write_registers(address, [int(one) for one in values])
        assert not reply.isError(), reply


class Mbpoll(Master):
    """The program mbpoll, started anew for each read and write."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self._port = port

    async def _run(self, address: int, *more: str) -> str:
        program = await asyncio.create_subprocess_exec(
            *("mbpoll", "-m", "tcp", "-p", str(self._port), "-a", "1", "-0", "-r", str(address)),
            *("-t", "4", "-o", "10", "-q", *more),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        output, _ = await program.communicate()
        assert program.returncode == 0, output.decode()
        return output.decode()

    async def read(self, address: int, count: int) -> list[int]:
        text = await self._run(address, "-c", str(count), "-1", "127.0.0.1")
        lines = [line.split(":") for line in text.splitlines() if line.startswith("[")]
        return [int(line[1].split()[0]) & 0xFFFF for line in lines]

    async def write(self, address: int, values: Sequence[int]) -> None:
        await self._run(address, "127.0.0.1", *(str(int(one)) for one in values))


@pytest.fixture
def plant() -> FakePlant:
    return FakePlant()


@pytest.fixture
async def port() -> int:
    return free_port()


@asynccontextmanager
async def pymodbus_at(port: int, *, at_rest: bool = True) -> AsyncIterator[Pymodbus]:
    async with asyncio.timeout(90):
        while not is_listening(port):  # noqa: ASYNC110 - a stranger's socket sets no event
            await asyncio.sleep(0.02)
    client = AsyncModbusTcpClient("127.0.0.1", port=port, timeout=30)
    assert await client.connect()
    try:
        master = Pymodbus(client)
        if at_rest:
            await master.write(100, [0])
        await master.beat()
        await master.beat()
        yield master
    finally:
        client.close()


@pytest.mark.skipif(not shutil.which("mbpoll"), reason="no mbpoll here (apt-get install mbpoll)")
async def test_a_stranger_runs_ten_parts_by_the_registers(plant: FakePlant, port: int) -> None:
    wire = plc_wire(port)
    async with served(wire, plant), worked(wire, plant):
        await eventually(lambda: is_listening(port))
        master = Mbpoll(port)
        await master.write(100, [0])
        assert (await master.read(0, 1)) == [1]
        for _ in range(2):
            await master.beat()
        found = []
        for part in range(1, 11):
            await master.until(Status.READY)
            assert Status.START_ACKNOWLEDGED in await master.start(1, f"SN-{part:02}")
            found.append(await master.take_result())
    assert [serial for _, serial, _ in found] == [f"SN-{part:02}" for part in range(1, 11)]
    assert [number for number, _, _ in found] == [result.seq for result in plant.results]
    assert [value for *_, value in found] == pytest.approx(
        [result.characteristics[0].measured for result in plant.results]
    )


@pytest.mark.parametrize("seed", range(4))
async def test_ten_parts_come_through_with_each_step_late_doubled_or_missing(
    plant: FakePlant, port: int, seed: int
) -> None:
    """Each write of the PLC may come twice, or be left out and come with the next try."""
    rng = random.Random(seed)
    wire = plc_wire(port)

    class Unsteady(Pymodbus):
        left_out: tuple[int, Sequence[int]] | None = None

        async def write(self, address: int, values: Sequence[int]) -> None:
            if address != 100:
                return await super().write(address, values)
            fault = rng.choice(("late", "doubled", "missing", "", ""))
            self.left_out = (address, values) if fault == "missing" else None
            if fault == "late":
                await asyncio.sleep(0.05)
            for _ in range({"missing": 0, "doubled": 2}.get(fault, 1)):
                await super().write(address, values)
            return None

        async def beat(self) -> None:
            if self.left_out is not None and rng.random() < 0.3:  # the next cycle of the PLC
                await super().write(*self.left_out)
                self.left_out = None
            if rng.random() < 0.3:
                await super().read(0, 66)  # an answer that is not looked at
            await super().beat()

    async with served(wire, plant), worked(wire, plant), pymodbus_at(port) as steady:
        master = Unsteady(steady._client)
        taken = 0
        while taken < 10:
            await master.until(Status.READY)
            status = await master.start(1, f"SN-{taken:02}")
            if Status.START_ACKNOWLEDGED not in status:
                continue
            if rng.random() < 0.3:  # the acknowledgement is missing for a while
                await master.until(Status.RESULT_VALID)
                await asyncio.sleep(0.05)
            number, serial, _ = await master.take_result()
            assert (number, serial) == (plant.results[taken].seq, f"SN-{taken:02}")
            taken += 1
    assert len([one for one in plant.told if one[0] == "order"]) == 10


async def test_several_parts_of_one_start_come_one_after_the_other(
    plant: FakePlant, port: int
) -> None:
    wire = plc_wire(port)
    async with served(wire, plant), worked(wire, plant), pymodbus_at(port) as master:
        await master.until(Status.READY)
        await master.start(1, quantity=12)
        await master.until(Status.RESULT_VALID)
        await master.until(Status.READY, is_set=False)  # more than eight wait
        assert Status.COMMAND_FAILED in await master.start(1)
        assert (await master.read(4, 1)) == [FailureReason.RESULTS_WAIT]
        numbers = [(await master.take_result())[0] for _ in range(12)]
        await master.until(Status.READY)
    assert numbers == [result.seq for result in plant.results]


async def test_a_result_that_was_not_acknowledged_is_shown_again_after_a_restart(
    plant: FakePlant, port: int
) -> None:
    first = plc_wire(port)
    async with served(first, plant), worked(first, plant), pymodbus_at(port) as master:
        await master.until(Status.READY)
        await master.start(1)
        await master.until(Status.RESULT_VALID)
        before = await master.read(6, 60)
    second = plc_wire(port)
    async with served(second, plant), pymodbus_at(port) as master:
        again = asyncio.create_task(deliver_surely(second, plant.results[0]))
        await master.until(Status.RESULT_VALID)
        assert await master.read(6, 60) == before
        await master.take_result()
        await again


async def test_an_order_of_before_a_restart_keeps_the_cell_busy(
    plant: FakePlant, port: int
) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port) as master:
        await master.until(Status.READY)
        await master.start(2)
    async with served(plc_wire(port), plant), pymodbus_at(port, at_rest=False) as master:
        await master.write(100, [START])  # a PLC that writes all its outputs in each cycle
        await master.until(Status.BUSY)
        await master.write(100, [0])
        assert Status.COMMAND_FAILED in await master.start(2)
        assert (await master.read(4, 1)) == [FailureReason.BUSY]
        (order,) = await plant.orders()
        plant.change_order(order.number, state="done")
        await master.until(Status.BUSY, is_set=False)
    assert len([one for one in plant.told if one[0] == "order"]) == 1


async def test_a_start_that_is_high_over_a_restart_starts_nothing(
    plant: FakePlant, port: int
) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port, at_rest=False) as master:
        for _ in range(3):
            await master.beat()  # register by register, in the PLC's own order
        await master.write(101, [1])
        for _ in range(3):
            await master.write(100, [START])
            await master.beat()
        status = Status((await master.read(1, 1))[0])
        assert not status & (Status.BUSY | Status.COMMAND_FAILED)
        await master.write(100, [0])
        assert Status.START_ACKNOWLEDGED in await master.start(1)
    assert len(plant.told) == 1


async def test_what_the_plc_did_not_order_is_not_for_it(plant: FakePlant, port: int) -> None:
    wire = plc_wire(port)
    async with served(wire, plant), pymodbus_at(port) as master:
        await wire.deliver(part_result(1, order="PO-4711"))
        await wire.deliver(part_result(2, order=None))
        await wire.deliver(part_result(3, order="PLC-1", revision=2))
        assert not Status((await master.read(1, 1))[0]) & Status.RESULT_VALID
        await plant.become(alarms=("estop",))
        await asyncio.sleep(0)
        await wire.deliver(alarm_notice())
        assert (await master.read(3, 1)) == [201]


async def test_stop_reaches_the_running_cell_and_a_refusal_has_a_reason(
    plant: FakePlant, port: int
) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port) as master:
        await master.write(100, [STOP])
        await master.until(Status.COMMAND_FAILED)
        assert (await master.read(4, 1)) == [FailureReason.STOP_REFUSED]  # nothing runs
        await master.write(100, [0])
        await plant.become(run="R1", is_ready=False)
        await master.write(100, [STOP])
        await eventually(lambda: len(plant.told) == 2)
        await master.until(Status.COMMAND_FAILED, is_set=False)
    assert plant.told == [("stop", "stop bit of the PLC", "PLC")] * 2


async def test_a_stop_takes_back_an_order_that_has_not_begun(plant: FakePlant, port: int) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port) as master:
        await master.until(Status.READY)
        await master.start(1)
        await master.write(100, [STOP])
        await master.until(Status.BUSY, is_set=False)
        await master.write(100, [0])
        await master.until(Status.READY)
        await master.start(1)
        second = (await plant.orders())[1]
        plant.change_order(second.number, state="running")
        await plant.become(run="R1", is_ready=False)
        await master.write(100, [STOP])
        await eventually(lambda: plant.told[-1][0] == "stop")
    assert [order.state for order in await plant.orders()] == ["stopped", "running"]


async def test_a_recipe_that_cannot_be_used_fails_the_start(plant: FakePlant, port: int) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port) as master:
        for recipe, reason in ((3, FailureReason.ORDER_REFUSED), (9, FailureReason.UNKNOWN_RECIPE)):
            await master.until(Status.READY)
            assert Status.COMMAND_FAILED in await master.start(recipe)
            assert (await master.read(4, 1)) == [reason]


async def exchange(port: int, *frames: bytes) -> bytes:
    """Return what comes back for bytes sent at once, until the server hangs up or waits."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(b"".join(frames))
    found = b""
    with contextlib.suppress(TimeoutError, ConnectionError):
        while piece := await asyncio.wait_for(reader.read(4096), 0.5):
            found += piece
    writer.close()
    return found


def frame(pdu: bytes, transaction: int = 1, protocol: int = 0) -> bytes:
    return struct.pack(">HHHB", transaction, protocol, len(pdu) + 1, 1) + pdu


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        (struct.pack(">BHH", 6, 99, 1), 2),  # the cell's own registers
        (struct.pack(">BHH", 6, 1, 0xFFFF), 2),
        (struct.pack(">BHH", 3, 0, 121), 2),
        (struct.pack(">BHH", 3, 65535, 2), 2),
        (struct.pack(">BHH", 3, 0, 0), 3),
        (struct.pack(">BHH", 3, 0, 126), 3),
        (struct.pack(">BHHB", 16, 100, 0, 0), 3),
        (struct.pack(">BHHBHH", 16, 119, 2, 4, 1, 1), 2),
        (struct.pack(">BHHBH", 16, 100, 2, 4, 1), 3),
        (struct.pack(">BHHHHBH", 23, 0, 121, 100, 1, 2, 1), 2),
        (struct.pack(">BHH", 5, 0, 0xFF00), 1),
        (b"\x2b\x0e\x01\x00", 1),
        (b"\x03", 3),
        (b"\xff" * 253, 1),
    ],
)
async def test_a_request_that_is_not_allowed_is_refused_and_changes_nothing(
    plant: FakePlant, port: int, pdu: bytes, code: int
) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port) as master:
        before = await master.read(100, 20)
        reply = await exchange(port, frame(pdu))
        assert reply[7:] == bytes((pdu[0] | 0x80, code))
        assert await master.read(100, 20) == before


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"\x16\x03\x01\x02\x00" + b"\x01" * 600,
        frame(b"\x03\x00\x00\x00\x01", protocol=7),
        struct.pack(">HHHB", 1, 0, 0xFFFF, 1) + b"x" * 10_000,
        struct.pack(">HHHB", 1, 0, 0, 1),
    ],
    ids=["http", "tls", "protocol", "too long", "too short"],
)
async def test_what_is_not_modbus_ends_its_connection_alone(
    plant: FakePlant, port: int, data: bytes
) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port) as master:
        assert await exchange(port, data) == b""
        assert (await master.read(0, 1)) == [1]


async def test_requests_that_come_together_are_answered_in_order(
    plant: FakePlant, port: int
) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port):
        ten = [frame(struct.pack(">BHH", 3, 0, 1), number) for number in range(1, 11)]
        reply = await exchange(port, *ten)
    assert [struct.unpack(">H", reply[at : at + 2])[0] for at in range(0, 110, 11)] == [
        *range(1, 11)
    ]


async def test_more_connections_than_a_plc_needs_do_not_keep_it_out(
    plant: FakePlant, port: int
) -> None:
    async with served(plc_wire(port), plant), pymodbus_at(port) as master:
        many = [await asyncio.open_connection("127.0.0.1", port) for _ in range(200)]
        assert (await master.read(0, 1)) == [1]
        closed = [await asyncio.wait_for(reader.read(1), 30) for reader, _ in many[20:]]
        assert closed == [b""] * 180
        for _, writer in many:
            writer.close()


async def test_an_address_that_is_not_named_may_not_connect() -> None:
    port = free_port()
    server = ModbusServer(4, 2, lambda: [0] * 4, lambda *_: None, frozenset({"192.0.2.7"}))
    task = asyncio.create_task(server.serve("127.0.0.1", port))
    await eventually(lambda: is_listening(port))
    assert await exchange(port, frame(b"\x03\x00\x00\x00\x01")) == b""
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def test_a_server_on_the_network_names_its_clients() -> None:
    with pytest.raises(ValueError, match="asks nobody who he is"):
        PlcSection.model_validate({"listen": "0.0.0.0:502", "recipes": {1: "holder"}})
    PlcSection.model_validate(
        {"listen": "0.0.0.0:502", "clients": ["192.0.2.7"], "recipes": {1: "holder"}}
    )


async def test_a_server_ends_while_a_client_is_connected_and_says_nothing_of_it() -> None:
    said: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, what: said.append(what))
    port = free_port()
    server = ModbusServer(4, 2, lambda: [0] * 4, lambda *_: None)
    task = asyncio.create_task(server.serve("127.0.0.1", port))
    await eventually(lambda: is_listening(port))
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(frame(b"\x03\x00\x00\x00\x01"))
    assert len(await reader.readexactly(11)) == 11
    task.cancel()
    async with asyncio.timeout(30):
        await asyncio.gather(task, return_exceptions=True)
    with suppress(ConnectionError):
        assert await reader.read() == b""
    writer.close()
    assert said == []
