"""The simulated loop: time that jumps, an order that a seed repeats, wires in memory, kills."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator

import pytest

from controller.virtual_time import NothingLeftError
from simulation.loop import SimulatedLoop, SimulatedProcess

HOUR_S = 3600.0


@contextlib.contextmanager
def a_loop(seed: int = 1) -> Iterator[SimulatedLoop]:
    loop = SimulatedLoop(seed)
    try:
        yield loop
    finally:
        loop.bury()
        loop.close()


def test_an_hour_of_sleep_is_an_hour_of_the_loops_time() -> None:
    with a_loop() as loop:
        began_s = loop.time()
        loop.run_until_complete(asyncio.sleep(HOUR_S))
        assert loop.time() - began_s == pytest.approx(HOUR_S)


def order_of(seed: int) -> list[int]:
    ran: list[int] = []

    async def step(number: int) -> None:
        for _ in range(5):
            await asyncio.sleep(0)
            ran.append(number)

    async def all_steps() -> None:
        await asyncio.gather(*(step(number) for number in range(6)))

    with a_loop(seed) as loop:
        loop.run_until_complete(all_steps())
    return ran


def test_the_seed_decides_which_of_several_ready_tasks_is_next() -> None:
    assert order_of(3) == order_of(3)
    assert len({tuple(order_of(seed)) for seed in range(5)}) == 5
    assert sorted(order_of(3)) == sorted(list(range(6)) * 5)


def test_plain_callbacks_run_in_the_order_they_were_asked_for() -> None:
    ran: list[int] = []

    async def asked() -> None:
        for number in range(50):
            asyncio.get_running_loop().call_soon(ran.append, number)
        await asyncio.sleep(0.1)

    for seed in range(3):
        ran.clear()
        with a_loop(seed) as loop:
            loop.run_until_complete(asked())
        assert ran == list(range(50))


def test_tasks_that_wait_for_one_another_are_an_error_and_no_hang() -> None:
    with a_loop() as loop, pytest.raises(NothingLeftError):
        loop.run_until_complete(loop.create_future())


def test_work_for_a_thread_is_done_and_its_error_comes_back() -> None:
    def fails() -> None:
        raise KeyError("no such thing")

    async def work() -> int:
        with pytest.raises(KeyError):
            await asyncio.to_thread(fails)
        return await asyncio.to_thread(sum, (1, 2, 3))

    with a_loop() as loop:
        assert loop.run_until_complete(work()) == 6


@contextlib.asynccontextmanager
async def an_echo() -> AsyncIterator[tuple[str, int]]:
    async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(100):
            writer.write(data.upper())
            await writer.drain()
        writer.close()

    server = await asyncio.start_server(echo, "127.0.0.1", 0)
    yield server.sockets[0].getsockname()
    server.close()


def test_streams_talk_over_byte_queues() -> None:
    async def talk() -> list[bytes]:
        async with an_echo() as where:
            reader, writer = await asyncio.open_connection(*where)
            heard = []
            for word in (b"first", b"second", b"third"):
                writer.write(word)
                heard.append(await reader.readexactly(len(word)))
            writer.close()
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(*where)
        return heard

    with a_loop() as loop:
        assert loop.run_until_complete(talk()) == [b"FIRST", b"SECOND", b"THIRD"]


def test_a_killed_process_does_nothing_more_and_its_peer_sees_the_line_close() -> None:
    done: list[str] = []

    async def controller(where: tuple[str, int]) -> None:
        _, writer = await asyncio.open_connection(*where)
        try:
            async with asyncio.TaskGroup() as both:
                both.create_task(asyncio.sleep(HOUR_S))
                writer.write(b"hello")
                await asyncio.sleep(HOUR_S)
        finally:
            done.append("finally")
            writer.write(b"goodbye")
            await asyncio.sleep(0)
            done.append("after an await")

    async def story(loop: SimulatedLoop) -> tuple[list[str], bytes]:
        heard = bytearray()
        ended = asyncio.Event()

        async def listen(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            while data := await reader.read(100):
                heard.extend(data)
            writer.close()
            ended.set()

        server = await asyncio.start_server(listen, "127.0.0.1", 0)
        process = SimulatedProcess("controller")
        loop.spawn(process, controller(server.sockets[0].getsockname()))
        await asyncio.sleep(1.0)
        loop.kill(process)
        await asyncio.wait_for(ended.wait(), 1.0)
        steps = process.step_count
        await asyncio.sleep(2 * HOUR_S)
        assert process.step_count == steps
        return list(done), bytes(heard)

    with a_loop() as loop:
        assert loop.run_until_complete(story(loop)) == ([], b"hello")


def test_a_timer_among_many_cancelled_ones_goes_off_once() -> None:
    went_off: list[float] = []

    async def story(loop: SimulatedLoop) -> None:
        for number in range(1000):
            loop.call_later(HOUR_S + number, went_off.append, -1.0).cancel()
        for number in range(5):
            loop.call_later(0.1 * number, went_off.append, float(number))
        await asyncio.sleep(1.0)

    with a_loop() as loop:
        loop.run_until_complete(story(loop))
    assert went_off == [0.0, 1.0, 2.0, 3.0, 4.0]
