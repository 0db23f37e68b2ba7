"""The picture process: it takes orders and makes pictures of them.

It caches the constant parts: static objects under each lamp, made when that lamp is first lit, and
the last picture of each camera if nothing in it moved. A test may run `PictureMaker` in its own
process.
"""

import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..shapes import Array
from .geometry import Array32, Scene, Surface
from .picture import Changes, Eye
from .sensor import Exposure, blurred, develop

if TYPE_CHECKING:
    from .machined import MachinedPart

Picture = NDArray[np.uint8] | NDArray[np.uint16]
END_WALL_S: Final = 30.0  # longest end of a parent that hung up, on a busy machine too
END_LOOK_WALL_S: Final = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """The picture process's order for one picture.

    Attributes
    ----------
    camera : its number in the scene
    poses : T_world_* of what moves and is there
    levels : levels of the lamps, by number
    """

    number: int
    slot: int
    camera: int
    poses: dict[str, Array]
    levels: dict[int, float]
    exposure: Exposure


@dataclass(frozen=True, slots=True, eq=False)
class Standpoint:
    """A camera's new pose: its number in the scene, and T_world_cam (4, 4)."""

    camera: int
    T_world_cam: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """The last picture of a camera; ``key`` holds all that its rays depend on."""

    key: bytes
    changes: Changes
    levels: dict[int, float]
    picture: Array32


class PictureMaker:
    """Makes pictures, one camera after another, and keeps reusable results."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._eyes: dict[int, Eye] = {}
        self._last: dict[int, _Kept] = {}
        self._parts: dict[str, MachinedPart] = {}

    def add(self, surface: Surface) -> None:
        """Take one more thing that moves, or one that looks otherwise now."""
        self._scene = self._scene.with_mover(surface)
        self._last.clear()
        self._parts.pop(surface.name, None)
        for eye in self._eyes.values():
            eye.add(surface)

    def stand(self, standpoint: Standpoint) -> None:
        """Move a camera to another pose."""
        number = standpoint.camera
        cameras = list(self._scene.cameras)
        cameras[number] = replace(cameras[number], T_world_cam=standpoint.T_world_cam)
        self._scene = replace(self._scene, cameras=tuple(cameras))
        self._eyes.pop(number, None)
        self._last.pop(number, None)

    def _eye(self, camera: int) -> Eye:
        if camera not in self._eyes:
            self._eyes[camera] = Eye(self._scene, camera, self._parts)
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
        key = repr(list(lit)).encode() + eye.depends_on(poses, list(lit))
        last = self._last.get(camera)
        if last is None or last.key != key:
            changes = eye.changes(poses, list(lit))
        elif last.levels == lit:
            return last.picture
        else:  # a lamp grows brighter or droops as it warms: no ray is cast again
            changes = last.changes
        layout = self._scene.cameras[camera]
        sharp = eye.mix(changes, lit) * np.float32(layout.sensitivity)
        kept = _Kept(key, changes, lit, blurred(sharp, layout.blur_px))
        self._last[camera] = kept
        return kept.picture

    def take(self, order: Order) -> Picture:
        """Return a finished picture, (h, w)."""
        return develop(self.radiance(order.camera, order.poses, order.levels), order.exposure)


def work(
    connection: Connection,
    memory_name: str,
    slot_bytes: int,
    scene: Scene,
    reap: Callable[[], None],
) -> None:
    """Make pictures until the other end hangs up; the picture process's main function.

    Parameters
    ----------
    connection : orders and new surfaces come in, word of finished pictures goes out
    memory_name, slot_bytes : shared memory for pictures, and the room for each
    scene : scene of all cameras
    reap : called when the other end has hung up, which it does when it is killed
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this by hanging up
    parent = os.getppid()
    cv2.setNumThreads(1)
    memory = SharedMemory(memory_name)
    maker = PictureMaker(scene)
    try:
        connection.send(("ready", -1, (0, 0), ""))
        while True:
            order = connection.recv()
            if isinstance(order, Surface):
                maker.add(order)
                continue
            if isinstance(order, Standpoint):
                maker.stand(order)
                continue
            picture = maker.take(order)
            start = order.slot * slot_bytes
            place: NDArray[Any] = np.ndarray(
                picture.shape, picture.dtype, buffer=memory.buf, offset=start
            )
            place[:] = picture
            del place
            connection.send(("picture", order.number, picture.shape, picture.dtype.str))
    except (EOFError, OSError):
        _await_end(parent)
        reap()
    finally:
        memory.close()


def _await_end(parent: int) -> None:
    """Wait until the parent has ended: a kernel hangs up before it lets go of locks and mounts."""
    for _ in range(round(END_WALL_S / END_LOOK_WALL_S)):
        if os.getppid() != parent:
            return
        time.sleep(END_LOOK_WALL_S)
