"""A test pattern instead of a world: every picture shows its instant and its brightness.

A camera without a cell around it: for tests of clients, and for `v4l2-ctl` or `arv-tool` by hand.
"""

import asyncio
import itertools
from collections.abc import Callable, Hashable
from typing import Final

import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_COLUMN_COUNT: Final = 80  # squares across the picture, whatever its size
_BIT_COUNT: Final = 64
NORMAL_EXPOSURE_S: Final = 0.0157  # gives NORMAL_LEVEL at gain 1
NORMAL_LEVEL: Final = 128.0


class ClockPattern:
    """Paints the instants of exposure [us] as two rows of black and white squares.

    The rest of the picture is as bright as exposure and gain make it. Runs on the event loop it
    is used in; `delay_wall_s` stands for the time that a real picture takes to make.

    Parameters
    ----------
    size_px : width and height of the pictures
    delay_wall_s : the time that a real picture would take to make [wall s]
    is_deep : 16 bits a pixel instead of 8, where the camera does not say
    """

    def __init__(
        self,
        size_px: tuple[int, int] = (1280, 1024),
        delay_wall_s: float = 0.0,
        *,
        is_deep: bool = False,
    ) -> None:
        self.delay_wall_s = delay_wall_s
        self._size_px, self._is_deep = size_px, is_deep
        self._tickets = itertools.count()
        self._deliver: Callable[[Hashable, Picture], None] | None = None

    def connect(self, deliver: Callable[[Hashable, Picture], None]) -> None:
        """Set the destination of the pictures: a device's `deliver`."""
        self._deliver = deliver

    def expose(
        self, start_s: float, end_s: float, exposure_s: float, gain: float, bits: int | None = None
    ) -> Hashable | None:
        """Order a picture; return its ticket, None before `connect`.

        Parameters
        ----------
        start_s, end_s : first and last instant of the exposure [world s]
        exposure_s : length of the exposure [s], for the brightness
        gain : factor on the brightness
        bits : of a pixel, 8 or 16
        """
        if self._deliver is None:
            return None
        ticket = next(self._tickets)
        picture = self.paint(start_s, end_s, exposure_s, gain, bits)
        loop = asyncio.get_running_loop()
        loop.call_later(self.delay_wall_s, self._deliver, ticket, picture)
        return ticket

    def paint(
        self, start_s: float, end_s: float, exposure_s: float, gain: float, bits: int | None = None
    ) -> Picture:
        """Return the picture of an exposure, (height, width).

        Parameters
        ----------
        start_s, end_s : first and last instant of the exposure [world s], one row of squares each
        exposure_s : length of the exposure [s], for the brightness of the ground
        gain : factor on that brightness
        bits : of a pixel, 8 or 16
        """
        is_deep = self._is_deep if bits is None else bits == 16
        width, height = self._size_px
        level = NORMAL_LEVEL * gain * exposure_s / NORMAL_EXPOSURE_S
        picture = np.full((height, width), min(255, round(level)), np.uint8)
        side = width // _COLUMN_COUNT
        for row, instant_s in enumerate((start_s, end_s)):
            digits = [round(instant_s * 1e6) >> bit & 1 for bit in range(_BIT_COUNT)]
            squares = np.repeat(np.array(digits, np.uint8) * np.uint8(255), side)
            picture[row * side : (row + 1) * side, : _BIT_COUNT * side] = squares
        return picture.astype(np.uint16) * np.uint16(257) if is_deep else picture


def read_clock_pattern(grey: npt.NDArray[np.uint8]) -> tuple[float, float]:
    """Return start and end of the exposure [world s] that a picture, (height, width), shows."""
    side = grey.shape[1] // _COLUMN_COUNT
    centre = side // 2
    instants = []
    for row in range(2):
        squares = grey[row * side + centre, centre : _BIT_COUNT * side : side]
        instants.append(sum(1 << bit for bit, level in enumerate(squares) if level > 127) * 1e-6)
    return instants[0], instants[1]
