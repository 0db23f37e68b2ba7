"""A camera: frames with a known instant of exposure."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Capture:
    """The settings of a camera, from the cell file.

    Attributes
    ----------
    width, height : width and height of a picture [px]
    formats : FourCC of pixel formats, the best first
    fps : frames a second
    exposure_s : exposure of one frame [s]
    settle_frames : of a stream just started, before one is trusted
    margin_s : play of a frame's time stamp [s]; None for the driver's own
    frame_late_s : a frame may come this much later than rate and exposure explain [cell s]
    """

    width: int
    height: int
    formats: tuple[str, ...]
    fps: float
    exposure_s: float
    settle_frames: int
    margin_s: float | None
    frame_late_s: float


class Frame(Protocol):
    """One picture."""

    @property
    def image(self) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Grey levels (height, width)."""
        ...

    @property
    def white(self) -> int:
        """The largest value of a pixel."""
        ...


@runtime_checkable
class TimedFrame(Frame, Protocol):
    """A picture with a known instant of exposure; not every camera has that."""

    @property
    def earliest_light_s(self) -> float:
        """The instant of the cell's clock before which no light was gathered [s]."""
        ...

    @property
    def timestamp_s(self) -> float:
        """The camera's own stamp [cell s]."""
        ...


class Camera(Protocol):
    """One camera.

    Attributes
    ----------
    model : name used in messages and the journal, once connected
    shape : height and width of its pictures [px]
    is_paused : True if the frames are stopped
    """

    @property
    def model(self) -> str: ...  # noqa: D102  (an attribute)

    @property
    def shape(self) -> tuple[int, int]: ...  # noqa: D102  (an attribute)

    @property
    def is_paused(self) -> bool: ...  # noqa: D102  (an attribute)

    async def connect(self) -> Any:  # noqa: ANN401  (whatever the driver says of it)
        """Find and open the camera, start the frames; return its identity, for the log."""
        ...

    async def pause(self) -> None:
        """Stop the frames, so that an idle camera costs nothing."""
        ...

    async def resume(self) -> None:
        """Start the frames again."""
        ...

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> Frame:
        """Return the first good frame exposed wholly after an instant of the cell's clock [s]."""
        ...

    async def close(self) -> None:
        """Stop the frames and close the camera."""
        ...
