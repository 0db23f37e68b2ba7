"""Orders for pictures, so that no wire and no step of the world waits for one.

`PictureDesk` takes orders from cameras, notes the world's state when an order falls due, sends it
to the picture process, and delivers finished pictures in a thread of its own.
"""

import hashlib
import itertools
import logging
import multiprocessing
import threading
from collections import Counter, deque
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ..shapes import Array
from .geometry import Scene, Surface
from .sensor import Exposure
from .worker import Order, Picture, Standpoint, work

log = logging.getLogger(__name__)

SLOT_COUNT: Final = 6  # pictures that may be in the making; more orders are refused
# scenes that differ by less are one: objects that moved come to rest within thousandths of this
SAME_MM: Final = 1.0
SAME_TURN: Final = 0.01  # largest difference of a rotation matrix's entries
_JOIN_S: Final = 5.0


class WorldState(Protocol):
    """The world's state for a picture."""

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


def nothing_is_left() -> None:
    """Take nothing away: what a desk by itself leaves behind."""


class PictureDesk:
    """Takes orders for pictures from cameras and has the picture process fill them.

    Parameters
    ----------
    scene : cameras, lamps and surfaces, sent to the worker once
    world : gives the poses of what moves and the levels of the lamps
    seed : decides the noise of every picture, with what is to be seen in it
    reap : called in the picture process once this one is gone; sent there, so a plain function

    Raises
    ------
    RuntimeError : from `note`, when the worker has died
    """

    def __init__(
        self,
        scene: Scene,
        world: WorldState,
        seed: int = 0,
        reap: Callable[[], None] = nothing_is_left,
    ) -> None:
        self._scene, self._world, self._seed = scene, world, seed
        self._reap = reap
        largest = max(camera.width_px * camera.height_px for camera in scene.cameras)
        self._slot_bytes = 2 * largest
        self._numbers = itertools.count(1)
        self._shown: Counter[bytes] = Counter()  # pictures of each scene so far
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
        """The picture process, once started."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the picture process; return when it takes orders.

        Raises
        ------
        RuntimeError : the worker ended while it loaded the scene
        """
        context = multiprocessing.get_context("spawn")
        self._memory = SharedMemory(create=True, size=SLOT_COUNT * self._slot_bytes)
        self._connection, far = context.Pipe()
        self._process = context.Process(
            target=work,
            args=(far, self._memory.name, self._slot_bytes, self._scene, self._reap),
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
        """End the picture process and free the memory; may be called twice."""
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

    def move_camera(self, number: int, T: Array) -> None:
        """Move a camera by T (4, 4) in its own frame [mm]; pictures noted from now on show it."""
        cameras = list(self._scene.cameras)
        cameras[number] = replace(cameras[number], T_world_cam=cameras[number].T_world_cam @ T)
        self._scene = replace(self._scene, cameras=tuple(cameras))
        if self._connection is not None:
            self._connection.send(Standpoint(number, cameras[number].T_world_cam))

    def add(self, surface: Surface) -> None:
        """Take one more movable object, or another look of one; pictures from now on show it."""
        self._scene = self._scene.with_mover(surface)
        if self._connection is not None:
            self._connection.send(surface)

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
            exposure = Exposure(exposure_s, gain, bits=bits)
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
            poses, levels = self._world.poses(), self._world.levels()
            for wish in due:
                seed = self._noise_seed(wish, poses, levels)
                exposure = replace(wish.exposure, seed=seed)
                self._connection.send(
                    Order(wish.number, wish.slot, wish.camera, poses, levels, exposure)
                )

    def _noise_seed(
        self, wish: _Wish, poses: Mapping[str, Array], levels: Mapping[int, float]
    ) -> int:
        """Return the seed of a picture's noise: of the desk's seed, the camera and the scene.

        By the instant, or by how many pictures there were, two runs of one seed would differ: when
        a picture is taken depends on how busy the machine is. Pictures of one scene differ by
        their number.
        """
        shown: list[object] = [
            self._seed,
            wish.camera,
            wish.exposure.exposure_s,
            wish.exposure.gain,
        ]
        for name, T in sorted(poses.items()):
            middle = np.round(T[:3, 3] / SAME_MM).astype(int)
            turn = np.round(T[:3, :3] / SAME_TURN).astype(int)
            shown += [name, *middle.tolist(), *turn.ravel().tolist()]
        # how bright a lamp is goes by how warm it is
        shown += [lamp for lamp, level in sorted(levels.items()) if level > 0]
        scene = hashlib.sha256(repr(shown).encode()).digest()
        self._shown[scene] += 1
        one = scene + self._shown[scene].to_bytes(4, "big")
        return int.from_bytes(hashlib.sha256(one).digest()[:8], "big")

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
