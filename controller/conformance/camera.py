"""Requirements on every camera."""

from __future__ import annotations

import asyncio
from typing import Any, Final

import numpy as np

from drivers.errors import DeviceError, ReplyTimeoutError

from . import _common
from .requirement import MeasuredFigure, Requirement, TestBench, known_silent, require, timed

SHORT_S: Final = 0.3  # patience with a frame that cannot come
FAR_S: Final = 1e4


async def _frame(bench: TestBench) -> Any:  # noqa: ANN401  (the driver's own frame)
    return await bench.device.frame_after(bench.clock.now_s())


def _frame_limit_s(bench: TestBench) -> float:
    """Return the time limit of a frame: two periods, an exposure, and its allowed delay [s]."""
    capture = bench.facts["capture"]
    return float(2.0 / capture.fps + capture.exposure_s + bench.bounds.frame_late_s)


async def _usable(bench: TestBench) -> None:
    await timed(bench, _frame_limit_s(bench), _frame(bench), "a frame")


async def _picture(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    frame = await _frame(bench)
    capture = bench.facts["capture"]
    expected = (capture.height, capture.width)
    require(tuple(device.shape) == expected, f"its shape is {device.shape}, not {expected}")
    image = frame.image
    require(image.shape == expected, f"a picture of {image.shape}, not {expected}")
    require(image.dtype in (np.uint8, np.uint16), f"grey levels of type {image.dtype}")
    require(
        int(image.max()) <= frame.white <= np.iinfo(image.dtype).max,
        f"white is {frame.white}, the brightest pixel {int(image.max())} of {image.dtype}",
    )
    return MeasuredFigure(remark=f"{capture.width} x {capture.height} px, white {frame.white}")


async def _after(bench: TestBench) -> MeasuredFigure:
    """Take a frame after an instant: it cannot be there before its exposure has passed."""
    device = await bench.opened()
    capture = bench.facts["capture"]
    # so late that the frames of two periods are to be passed over, and one may be waiting
    ahead_s = 2.0 / capture.fps
    asked_s, t_s = bench.stopwatch.now_s(), bench.clock.now_s() + ahead_s
    await device.frame_after(t_s)
    waited_s = bench.clock.now_s() - t_s
    took_s = bench.stopwatch.now_s() - asked_s - ahead_s
    require(
        waited_s >= capture.exposure_s,
        f"a frame came {waited_s * 1e3:.0f} ms after the instant, its exposure alone takes "
        f"{capture.exposure_s * 1e3:.0f} ms",
    )
    allowed_s = bench.clock.patience_s(_frame_limit_s(bench))
    require(took_s <= allowed_s, f"a frame came {took_s:.2f} s after the instant")
    return MeasuredFigure(took_s * 1e3, "ms", allowed_s * 1e3, "from instant to frame")


async def _pause(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    for _ in range(2):
        await device.pause()
    require(device.is_paused is True, "paused, it claims to run")
    try:
        await device.frame_after(bench.clock.now_s(), SHORT_S)
    except (ValueError, DeviceError):
        pass
    else:
        require(False, "paused, it returned a frame")
    for _ in range(2):
        await device.resume()
    require(device.is_paused is False, "resumed, it claims to be paused")
    limit_s = _frame_limit_s(bench)
    took_s = await timed(bench, limit_s, _frame(bench), "the first frame after a pause")
    return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(limit_s) * 1e3)


async def _patience(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    limit_s = SHORT_S + 1.0 / bench.facts["capture"].fps

    async def never() -> Any:  # noqa: ANN401  (no frame at all)
        return await device.frame_after(bench.clock.now_s() + FAR_S, SHORT_S)

    took_s = await known_silent(bench, limit_s, never, ReplyTimeoutError)
    await _usable(bench)
    return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(limit_s) * 1e3)


async def _unplugged(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    limit_s = _frame_limit_s(bench) + bench.bounds.answer_s
    await bench.line.cut()
    try:
        waiting = asyncio.ensure_future(_frame(bench))
        await bench.clock.wait([waiting], limit_s)
        require(waiting.done(), f"unplugged, a frame is awaited for more than {limit_s:.1f} s")
        error = waiting.exception()
        require(isinstance(error, DeviceError), f"unplugged, it ended with {error!r:.80}")
    finally:
        waiting.cancel()
        await asyncio.gather(waiting, return_exceptions=True)
        await bench.line.mend()

    async def back() -> None:
        while True:
            try:
                await device.close()
                await device.connect()
                await _frame(bench)
            except DeviceError:
                await bench.clock.sleep(0.1)
            else:
                return

    took_s = await timed(bench, limit_s, back(), "plugged in again")
    limit_ms = bench.clock.patience_s(limit_s) * 1e3
    return MeasuredFigure(took_s * 1e3, "ms", limit_ms, "until a frame comes again")


async def _read(device: Any) -> None:  # noqa: ANN401  (a camera)
    require(device.shape is not None, "no shape")


REQUIREMENTS: Final = (
    _common.identity(),
    Requirement("picture", "Pictures are grey, of the size in the cell file.", _picture),
    Requirement("after", "A frame is exposed wholly after the instant given.", _after),
    Requirement("pause", "Paused, it returns no frame; resumed, it does.", _pause),
    Requirement("time-out", "A frame that does not come ends in time with an error.", _patience),
    Requirement(
        "reconnect",
        "Unplugged it raises an error; plugged in, it opens again.",
        _unplugged,
        cuts=True,
    ),
    _common.cancellation(_frame, _frame, _frame_limit_s),
    _common.closing("close", _read),
)
