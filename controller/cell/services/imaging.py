"""Takes pictures, each exposed wholly after the lamps had settled, and stores them."""

import asyncio
import hashlib
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from controller.arrays import Grey
from drivers.errors import LinkError
from drivers.kinds import Camera, Frame, LampUnit
from messages import say

from .faults import Retries

log = logging.getLogger(__name__)

CameraName = Literal["overhead", "inspection"]

# Long enough for a slow camera; one that stalls is a fault.
LOOK_TIMEOUT_S = 30.0


class Imaging:
    """The lamps and both cameras.

    Parameters
    ----------
    lights : all lamps of the cell
    cameras : the driver of each
    quick : cameras whose stream starts at once, so that it is paused between pictures
    folder : folder of the run; pictures go to its ``pictures``
    on_stored : called with the file and the SHA-256 of each picture that is stored
    retries : retries of a lamp or a camera that fails; None for none
    """

    def __init__(
        self,
        lights: LampUnit,
        cameras: Mapping[CameraName, Camera],
        quick: frozenset[CameraName],
        folder: Path,
        on_stored: Callable[[str, str], None] = lambda file, digest: None,
        retries: Retries | None = None,
    ) -> None:
        self._lights = lights
        self._cameras = cameras
        self._quick = quick
        self._folder = folder
        self._retries = retries
        self._on_stored = on_stored

    async def shoot(self, camera: CameraName, lamps: Mapping[str, float]) -> Grey:
        """Return a picture (height, width), exposed after the lamps had settled.

        Parameters
        ----------
        camera : camera to use
        lamps : levels of the lamps by name, 0..1; all others are dark

        Raises
        ------
        DeviceError : a lamp does not confirm, or no frame comes, as often as the policy has it
        """
        everything = dict.fromkeys(self._lights.names, 0.0) | dict(lamps)

        async def light() -> float:
            return await self._lights.set(everything, settle=True)

        device = self._cameras[camera]

        async def connect_again() -> None:
            await device.close()
            await device.connect()

        if self._retries is None:
            frame = await self._take(camera, await light())
        else:
            lit_at_s = await self._retries.run("lights", "lights", light)
            frame = await self._retries.run(
                "camera", camera, lambda: self._take(camera, lit_at_s), connect_again
            )
        image = frame.image
        if image.dtype != np.uint8:
            image = np.rint(image.astype(np.float32) * (255.0 / frame.white)).astype(np.uint8)
        return np.ascontiguousarray(image)

    async def _take(self, camera: CameraName, lit_at_s: float) -> Frame:
        device = self._cameras[camera]
        if device.is_paused:
            await device.resume()
        try:
            return await device.frame_after(lit_at_s, LOOK_TIMEOUT_S)
        finally:
            if camera in self._quick:
                await self.pause(camera)

    async def pause(self, camera: CameraName) -> None:
        """Stop a camera's stream; the next picture starts it again. A lost camera has none."""
        try:
            await self._cameras[camera].pause()
        except LinkError as error:
            log.info("%s camera: not paused: %s", camera, error)

    async def all_dark(self) -> None:
        """Switch every lamp off."""
        await self._lights.all_off()

    async def save(self, part_number: int, name: str, image: Grey) -> str:
        """Store a picture of a part; return its file, relative to the run's folder.

        Parameters
        ----------
        part_number : number of the part in the picture
        name : subject of the picture
        image : (height, width)

        Raises
        ------
        OSError : it cannot be written
        """
        path = self._folder / "pictures" / f"part{part_number:03d}_{name}.png"
        digest = await asyncio.to_thread(_write_picture, path, image)
        file = str(path.relative_to(self._folder))
        self._on_stored(file, digest)
        return file


def _write_picture(path: Path, image: Grey) -> str:
    """Write a picture and return the SHA-256 of its file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    try:
        path.write_bytes(data)
    except OSError as error:
        reason = say("cannot be written ({strerror}); is the disk full?", strerror=error.strerror)
        raise OSError(error.errno, reason, str(path)) from error
    return hashlib.sha256(data).hexdigest()
