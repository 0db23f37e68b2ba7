"""`cellctl doctor --pictures`: the cameras' pictures, lamp by lamp; nothing moves."""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import cv2

from controller.arrays import Grey
from controller.cell.devices import Devices
from controller.cell.devices.lamps import STATION_LAMPS, STATION_PANEL, TABLE_LAMPS, TABLE_PANEL
from controller.cell.services.imaging import CameraName, Imaging
from drivers.clock import CellClock

LAMPS: Final[Mapping[CameraName, tuple[str, str]]] = {
    "overhead": (TABLE_PANEL, TABLE_LAMPS[0]),
    "inspection": (STATION_PANEL, STATION_LAMPS[0]),
}
KEPT_COUNT: Final = 2  # pictures kept per camera and lamp: one may be in use by a reader
PAUSE_S: Final = 0.3


async def take_pictures(
    devices: Devices,
    clock: CellClock,
    folder: Path,
    seconds: float,
    on_picture: Callable[[dict[str, Any]], None],
) -> None:
    """Take a picture with each camera under two lamps, repeatedly; all lamps are dark then.

    Files are named by camera, lamp and number. Older ones of the same kind are deleted.

    Parameters
    ----------
    devices : cameras and lamps are connected
    clock : clock of the cell
    folder : folder for the pictures; exists
    seconds : duration; each picture is taken once at least
    on_picture : called with camera, lamp and file of each picture

    Raises
    ------
    DeviceError : a lamp or a camera fails
    OSError : a picture cannot be written
    """
    cameras = {"overhead": devices.overhead, "inspection": devices.inspection}
    imaging = Imaging(devices.lights, {name: cameras[name] for name in LAMPS}, frozenset(), folder)
    began_s, number = clock.now_s(), 0
    try:
        while True:
            for camera, lamps in LAMPS.items():
                for lamp in lamps:
                    image = await imaging.shoot(camera, {lamp: 1.0})
                    file = await asyncio.to_thread(_keep, folder, f"{camera}-{lamp}", number, image)
                    on_picture({"event": "picture", "camera": camera, "lamp": lamp, "file": file})
            number += 1
            if clock.now_s() - began_s >= seconds:
                return
            await clock.sleep(PAUSE_S)
    finally:
        await asyncio.shield(imaging.all_dark())


def _keep(folder: Path, kind: str, number: int, image: Grey) -> str:
    """Write a picture, delete an older one of its kind, and return the name of its file."""
    name = f"{kind}-{number:06d}.png"
    draft = folder / f".{name}"
    draft.write_bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())
    draft.replace(folder / name)
    (folder / f"{kind}-{number - KEPT_COUNT:06d}.png").unlink(missing_ok=True)
    return name
