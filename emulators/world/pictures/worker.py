"""What the picture process runs: it takes orders and makes pictures of them.

It keeps what does not change: what stands still, and the last picture of each camera if nothing
in it moved. A test may run `PictureMaker` in its own process.
"""

import signal
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..layout import Array
from .geometry import Array32, Scene
from .picture import Eye
from .sensor import Exposure, blurred, develop

Picture = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """What the worker needs for one picture.

    Attributes
    ----------
    camera : its number in the scene
    poses : T_world_* of what moves and is there
    levels : of the lamps, by number
    """

    number: int
    slot: int
    camera: int
    poses: dict[str, Array]
    levels: dict[int, float]
    exposure: Exposure


class PictureMaker:
    """Makes pictures, one camera after another, and keeps what can serve again."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._eyes: dict[int, Eye] = {}
        self._last: dict[int, tuple[bytes, Array32]] = {}

    def warm_up(self) -> None:
        """Make what the first pictures would wait for, seconds of work."""
        for camera in range(len(self._scene.cameras)):
            self._eye(camera).warm_up()

    def _eye(self, camera: int) -> Eye:
        if camera not in self._eyes:
            self._eyes[camera] = Eye(self._scene, camera)
        return self._eyes[camera]

    def radiance(
        self, camera: int, poses: Mapping[str, Array], levels: Mapping[int, float]
    ) -> Array32:
        """Return the blurred picture before noise and digits, (h, w); kept if nothing changes.

        Parameters
        ----------
        camera : number of the camera in the scene
        poses : (4, 4) T_world of each thing that moves, by its name [mm]
        levels : level of each lamp, 0 to 1, by its number in the scene
        """
        eye = self._eye(camera)
        lit = {lamp: level for lamp, level in sorted(levels.items()) if level > 0.0}
        key = repr(lit).encode() + eye.depends_on(poses, list(lit))
        last = self._last.get(camera)
        if last is None or last[0] != key:
            last = (key, blurred(eye.picture(poses, lit)))
            self._last[camera] = last
        return last[1]

    def take(self, order: Order) -> Picture:
        """Return a finished picture, (h, w)."""
        return develop(self.radiance(order.camera, order.poses, order.levels), order.exposure)


def work(connection: Connection, memory_name: str, slot_bytes: int, scene: Scene) -> None:
    """Take pictures until the other end hangs up; the picture process's main function.

    Parameters
    ----------
    connection : orders come in, word of finished pictures goes out
    memory_name, slot_bytes : shared memory for pictures, and the room for each
    scene : what all cameras look at
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this by hanging up
    cv2.setNumThreads(1)
    memory = SharedMemory(memory_name)
    maker = PictureMaker(scene)
    try:
        maker.warm_up()
        connection.send(("ready", -1, (0, 0), ""))
        while True:
            order = connection.recv()
            picture = maker.take(order)
            start = order.slot * slot_bytes
            place: NDArray[Any] = np.ndarray(
                picture.shape, picture.dtype, buffer=memory.buf, offset=start
            )
            place[:] = picture
            del place
            connection.send(("picture", order.number, picture.shape, picture.dtype.str))
    except (EOFError, OSError):
        pass
    finally:
        memory.close()
