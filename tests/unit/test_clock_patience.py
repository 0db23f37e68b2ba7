"""Time-outs follow the cell's clock, not asyncio's, and never expire because a process is late."""

import asyncio
import os
import time
from collections.abc import Callable

import pytest

from drivers.attendance import Attendance
from drivers.clock import CellClock
from drivers.patience import Patience

Wait = Callable[[], "asyncio.Future[None]"]


class StoppedClock:
    """A clock that goes on when the test says so."""

    def __init__(self) -> None:
        self.instant_s = 5.0

    def now_s(self) -> float:
        return self.instant_s

    def patience(self, duration_s: float) -> Patience:
        return Patience(self.now_s, 1e3, duration_s)


def forever() -> "asyncio.Future[None]":
    return asyncio.get_running_loop().create_future()


async def turns(count: int = 30) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


async def test_no_time_out_while_the_clock_stands_still() -> None:
    clock = StoppedClock()

    async def wait() -> None:
        async with clock.patience(1.0):
            await forever()

    task = asyncio.create_task(wait())
    await asyncio.sleep(0.05)  # fifty times what it would take if the clock ran
    assert not task.done()
    clock.instant_s += 0.999
    await asyncio.sleep(0.01)
    assert not task.done()
    clock.instant_s += 0.001
    with pytest.raises(TimeoutError):
        await task


async def test_what_has_arrived_when_time_is_up_counts() -> None:
    # the loop was held up for longer than the time-out; meanwhile the reply came
    loop = asyncio.get_running_loop()
    near, far = os.pipe()
    arrived = asyncio.Event()
    loop.add_reader(near, arrived.set)
    try:
        async with CellClock().timeout(0.01):
            os.write(far, b"reply")
            time.sleep(0.03)  # noqa: ASYNC251  (the loop is held up)
            # as far from the wire as a reply of a Modbus link is from its caller
            await asyncio.wait_for(asyncio.shield(asyncio.ensure_future(arrived.wait())), None)
    finally:
        loop.remove_reader(near)
        os.close(near)
        os.close(far)


async def test_it_is_over_at_once_where_nothing_is_waited_for() -> None:
    async with CellClock().timeout(0.0) as scope:
        pass
    assert not scope.expired()
    with pytest.raises(TimeoutError):
        async with CellClock().timeout(0.0) as scope:
            await forever()
    assert scope.expired()


async def test_of_nested_time_outs_the_outer_one_reaches_the_outside() -> None:
    clock = StoppedClock()
    reached = []

    async def wait() -> None:
        async with clock.patience(1.0):
            try:
                async with clock.patience(2.0):
                    await forever()
            except TimeoutError:
                reached.append("inner")
            await forever()

    task = asyncio.create_task(wait())
    await turns()
    clock.instant_s += 1.5
    with pytest.raises(TimeoutError):
        await task
    assert reached == []


async def test_an_inner_time_out_leaves_the_outer_one_running() -> None:
    clock = StoppedClock()
    reached = []

    async def wait() -> None:
        async with clock.patience(2.0):
            with pytest.raises(TimeoutError):
                async with clock.patience(1.0):
                    await forever()
            reached.append("inner")
            await forever()

    task = asyncio.create_task(wait())
    await turns()
    clock.instant_s += 1.0
    while not reached:  # noqa: ASYNC110
        await asyncio.sleep(0.001)
    assert not task.done()
    clock.instant_s += 1.0
    with pytest.raises(TimeoutError):
        await task


async def test_a_cancellation_from_outside_stays_one() -> None:
    clock = StoppedClock()

    async def wait() -> None:
        async with clock.patience(1.0):
            await forever()

    task = asyncio.create_task(wait())
    await turns()
    clock.instant_s += 2.0  # time is up, too
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert task.cancelling() == 1


async def test_an_error_inside_passes_through_and_leaves_no_timer() -> None:
    clock = StoppedClock()
    with pytest.raises(ZeroDivisionError):
        async with clock.patience(1.0) as scope:
            raise ZeroDivisionError
    clock.instant_s += 2.0
    await asyncio.sleep(0.01)
    assert not scope.expired()


async def test_a_wait_ends_with_what_it_waits_for_or_with_its_time() -> None:
    clock = CellClock(speed=100.0)
    done, never = asyncio.ensure_future(asyncio.sleep(0)), forever()
    await clock.wait({done, never}, 60.0, return_when=asyncio.FIRST_COMPLETED)
    assert done.done()
    await clock.wait({never}, 1.0)
    assert not never.done()
    never.cancel()


async def test_what_a_busy_process_missed_is_not_the_devices_time() -> None:
    clock = CellClock()
    async with clock.attending():
        now_s, attended_s = clock.now_s(), clock.attended_s()
        time.sleep(0.3)  # noqa: ASYNC251  (the loop is held up)
        missed_s = (clock.now_s() - now_s) - (clock.attended_s() - attended_s)
        # known at once, before the beat that measures it has come
        assert missed_s == pytest.approx(0.3, abs=0.05) or missed_s > 0.3
        await asyncio.sleep(0.05)
        later_s = (clock.now_s() - now_s) - (clock.attended_s() - attended_s)
        assert later_s >= missed_s - 1e-6
    assert clock.missed_wall_s >= missed_s - 1e-6


async def test_a_time_out_waits_as_long_as_its_process_was_late() -> None:
    clock = CellClock()
    reply = forever()
    async with clock.attending(), clock.timeout(0.2):
        time.sleep(0.5)  # noqa: ASYNC251  (the loop is held up)
        # a device that answers once it is asked: not before the loop turns again
        asyncio.get_running_loop().call_later(0.05, reply.set_result, None)
        await reply


async def test_the_attended_scale_never_goes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr("drivers.attendance.time.monotonic", lambda: now_s[0])
    attendance, lost = Attendance(), 0.0
    async with attendance.beating():
        for pause_s in (0.001, 0.5, 0.01, 2.0, 0.03):
            now_s[0] += pause_s
            assert lost <= attendance.lost_s() <= lost + pause_s + 1e-6
            lost = attendance.lost_s()


async def test_by_a_clock_that_stands_still_nothing_is_missed() -> None:
    clock = StoppedClock()
    attendance = Attendance(clock.now_s, beat_wall_s=0.001, speed=4.0, jitter_s=0.01)
    async with attendance.beating():
        await asyncio.sleep(0.02)
        assert attendance.lost_s() == 0.0
        clock.instant_s += 1.0  # less what is due until the next beat, and the jitter
        assert attendance.lost_s() == pytest.approx(1.0 - 0.004 - 0.01)
