"""Requirements shared by several kinds of devices, built from the readings of each."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from drivers.errors import LinkError

from .requirement import (
    MeasuredFigure,
    Requirement,
    TestBench,
    cancel_often,
    known_silent,
    naming,
    require_model,
    timed,
)

Reading = Callable[[Any], Awaitable[Any]]


def identity() -> Requirement:
    """Return the requirement that a connected device can be named."""

    async def trial(bench: TestBench) -> MeasuredFigure:
        await bench.opened()
        return require_model(bench)

    return Requirement("identity", "After `connect` the device has a model name.", trial)


def closing(close: str, reading: Reading) -> Requirement:
    """Return the requirement that closing is idempotent and that the device opens again.

    Parameters
    ----------
    close : name of the method
    reading : function that returns a reading of the device
    """

    async def trial(bench: TestBench) -> MeasuredFigure:
        device = await bench.opened()
        for number in range(2):
            with naming(f"closed {number + 1} times"):
                await getattr(device, close)()
        with naming("opened after closing"):
            await device.connect()
            await reading(device)
        return MeasuredFigure()

    return Requirement(
        "close", "Closing twice does no harm, and the same driver opens again.", trial
    )


def silence(reading: Reading, limit_s: Callable[[TestBench], float]) -> Requirement:
    """Return the requirement that a silent device is reported in time.

    Parameters
    ----------
    reading : function that returns a reading of the device
    limit_s : function that returns the time limit of that
    """

    async def trial(bench: TestBench) -> MeasuredFigure:
        device = await bench.opened()
        await bench.line.silence()
        try:
            limit = limit_s(bench)
            took_s = await known_silent(bench, limit, lambda: reading(device), LinkError)
        finally:
            await bench.line.mend()
            await bench.close()
        return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(limit) * 1e3)

    return Requirement(
        "time-out", "A silent device ends a reading with LinkError in time.", trial, cuts=True
    )


def reconnection(reading: Reading, close: str = "") -> Requirement:
    """Return the requirement that a device that was cut off can be used again.

    Parameters
    ----------
    reading : function that returns a reading of the device
    close : method that has to be called before `connect`; none where `connect` is enough
    """

    async def trial(bench: TestBench) -> MeasuredFigure:
        device = await bench.opened()
        await bench.line.cut()
        try:
            limit = bench.bounds.answer_s
            await known_silent(bench, limit, lambda: reading(device), LinkError)
        finally:
            await bench.line.mend()

        async def back() -> None:
            while True:
                try:
                    if close:
                        await getattr(device, close)()
                    await device.connect()
                    await reading(device)
                except LinkError:
                    await bench.clock.sleep(0.1)
                else:
                    return

        with naming("after the line was mended"):
            took_s = await timed(bench, limit, back(), "after the line was mended")
        return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(limit) * 1e3)

    return Requirement(
        "reconnect", "Cut off and mended, the same driver connects again.", trial, cuts=True
    )


def cancellation(
    reading: Callable[[TestBench], Awaitable[Any]],
    check: Callable[[TestBench], Awaitable[Any]],
    limit_s: Callable[[TestBench], float] = lambda bench: bench.bounds.answer_s,
) -> Requirement:
    """Return the requirement that a cancelled exchange leaves the line usable.

    Parameters
    ----------
    reading : function that returns the awaitable to cancel
    check : raises `NotMetError` if the device does not answer as it should
    limit_s : function that returns the time limit of the check
    """

    async def trial(bench: TestBench) -> MeasuredFigure:
        await bench.opened()

        async def usable() -> None:
            with naming("after a cancellation"):
                await check(bench)

        return await cancel_often(bench, lambda: reading(bench), usable, limit_s(bench))

    return Requirement(
        "cancellation", "A cancelled exchange ends at once and leaves the line usable.", trial
    )
