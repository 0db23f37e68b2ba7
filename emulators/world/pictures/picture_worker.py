"""Pictures in a process of their own, so that no wire and no step of the world waits for one.

`PictureDesk` takes orders from cameras, has the world's state noted when its time has come, sends
that to the worker, and hands finished pictures back in a thread of its own. The worker keeps what
does not change: what stands still, and the last picture of each camera if nothing in it moved.
"""

import itertools
import logging
import multiprocessing
import signal
import threading
from collections import deque
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from typing import Any, Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ..layout import Array
from .geometry import Array32, Scene
from .picture import Eye
from .sensor import Exposure, blurred, develop

log = logging.getLogger(__name__)

Picture = NDArray[np.uint8] | NDArray[np.uint16]

SLOT_COUNT: Final = 6  # pictures that may be in the making; more orders are refused
_JOIN_S: Final = 5.0


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


class Studio:
    """Makes pictures; what the worker process runs, and what a test may run by itself."""

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


def _work(connection: Connection, memory_name: str, slot_bytes: int, scene: Scene) -> None:
    """Take pictures until the other end hangs up; the worker process's main function."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this by hanging up
    cv2.setNumThreads(1)
    memory = SharedMemory(memory_name)
    studio = Studio(scene)
    try:
        studio.warm_up()
        connection.send(("ready", -1, (0, 0), ""))
        while True:
            order = connection.recv()
            picture = studio.take(order)
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


class Stage(Protocol):
    """The state of the world that a picture shows."""

    def poses(self) -> dict[str, Array]:
        """Return T_world_* of everything that moves and is there."""
        ...

    def levels(self) -> dict[int, float]:
        """Return the light of each lamp, by its number in the scene."""
        ...


@dataclass(slots=True, eq=False)
class _Wish:
    number: int
    camera: int
    due_s: float
    exposure: Exposure
    deliver: Callable[[Hashable, Picture], None]
    slot: int = -1


class PictureDesk:
    """Between cameras, the world and the worker.

    Parameters
    ----------
    scene : cameras, lamps and surfaces, sent to the worker once
    stage : gives the poses of what moves and the levels of the lamps
    seed : decides the noise of every picture

    Raises
    ------
    RuntimeError : from `note`, when the worker has died
    """

    def __init__(self, scene: Scene, stage: Stage, seed: int = 0) -> None:
        self._scene, self._stage, self._seed = scene, stage, seed
        largest = max(camera.width_px * camera.height_px for camera in scene.cameras)
        self._slot_bytes = 2 * largest
        self._numbers = itertools.count(1)
        self._taken: dict[int, int] = {}  # pictures ordered so far, by camera: seeds the noise
        self._lock = threading.Lock()
        self._waiting: deque[_Wish] = deque()
        self._sent: dict[int, _Wish] = {}
        self._free = list(range(SLOT_COUNT))
        self._is_ready = threading.Event()
        self._is_dead = False
        self._memory: SharedMemory | None = None
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None
        self._thread: threading.Thread | None = None

    @property
    def worker_pid(self) -> int | None:
        """The worker process, once started."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the worker; returns when it can take pictures.

        Raises
        ------
        RuntimeError : the worker ended while it loaded the scene
        """
        context = multiprocessing.get_context("spawn")
        self._memory = SharedMemory(create=True, size=SLOT_COUNT * self._slot_bytes)
        self._connection, far = context.Pipe()
        self._process = context.Process(
            target=_work,
            args=(far, self._memory.name, self._slot_bytes, self._scene),
            name="pictures",
            daemon=True,
        )
        self._process.start()
        far.close()
        self._thread = threading.Thread(target=self._receive, name="pictures", daemon=True)
        self._thread.start()
        self._is_ready.wait()
        if self._is_dead:
            raise RuntimeError("the picture worker could not start")

    def close(self) -> None:
        """End the worker and give the memory back; may be called twice."""
        connection, self._connection = self._connection, None
        if self._process is not None:
            # a half-open pipe would keep the receiving thread; the worker's end closes it
            self._process.terminate()
            self._process.join(_JOIN_S)
            self._process = None
        if self._thread is not None:
            self._thread.join(_JOIN_S)
            self._thread = None
        if connection is not None:
            connection.close()
        if self._memory is not None:
            self._memory.close()
            self._memory.unlink()
            self._memory = None

    def order(
        self,
        camera: int,
        due_s: float,
        exposure_s: float,
        gain: float,
        bits: int,
        deliver: Callable[[Hashable, Picture], None],
    ) -> int | None:
        """Order a picture of the world at ``due_s``; return its number, None if too many wait.

        Parameters
        ----------
        camera : number of the camera in the scene
        due_s : instant whose state of the world the picture shows [world s]
        exposure_s : length of the exposure [s]
        gain : factor on the signal
        bits : digits of a pixel, 8 or 16
        deliver : called with the order's number and the picture, (height, width), from a thread of
            the desk
        """
        with self._lock:
            if self._is_dead or not self._free:
                return None
            count = self._taken[camera] = self._taken.get(camera, 0) + 1
            seed = (self._seed * 1_000_003 + camera) * 1_000_003 + count
            exposure = Exposure(exposure_s, gain, seed % 2**63, bits)
            number = next(self._numbers)
            self._waiting.append(_Wish(number, camera, due_s, exposure, deliver, self._free.pop()))
            return number

    def note(self, now_s: float) -> None:
        """Send off the orders whose time has come; called as the world advances [world s].

        Raises
        ------
        RuntimeError : the worker has died
        """
        if self._is_dead:
            raise RuntimeError("the picture worker has died")
        if not self._waiting:
            return
        with self._lock:
            due = [wish for wish in self._waiting if wish.due_s <= now_s]
            for wish in due:
                self._waiting.remove(wish)
                self._sent[wish.number] = wish
        if due and self._connection is not None:
            poses, levels = self._stage.poses(), self._stage.levels()
            for wish in due:
                self._connection.send(
                    Order(wish.number, wish.slot, wish.camera, poses, levels, wish.exposure)
                )

    def _receive(self) -> None:
        connection, memory = self._connection, self._memory
        if connection is None or memory is None:
            return
        try:
            while True:
                kind, number, shape, dtype = connection.recv()
                if kind == "ready":
                    self._is_ready.set()
                    continue
                with self._lock:
                    wish = self._sent.pop(number)
                start = wish.slot * self._slot_bytes
                place: NDArray[Any] = np.ndarray(
                    shape, np.dtype(dtype), buffer=memory.buf, offset=start
                )
                picture = place.copy()
                del place
                with self._lock:
                    self._free.append(wish.slot)
                wish.deliver(number, picture)
        except (EOFError, OSError):
            self._is_dead = True
            self._is_ready.set()
