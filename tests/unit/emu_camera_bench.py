"""An emulated camera whose time and pictures the test controls."""

from dataclasses import dataclass, field

import numpy as np
from emu_camera_client import Client

from emulators.camera_v4l2 import CameraConfig, Picture, V4l2Device

EPOCH_MONOTONIC_S = 5000.0  # CLOCK_MONOTONIC at world time zero
SPEED = 4.0


@dataclass(slots=True)
class ManualClock:
    world_s: float = 0.0

    def now_s(self) -> float:
        return self.world_s

    def to_monotonic_s(self, world_s: float) -> float:
        return EPOCH_MONOTONIC_S + world_s / SPEED


@dataclass(slots=True)
class Exposures:
    """A picture source that only notes what it is asked for; tickets count from 0."""

    asked: list[tuple[float, float, float, float]] = field(default_factory=list)
    refuses: bool = False

    def expose(self, start_s: float, end_s: float, exposure_s: float, gain: float) -> int | None:
        if self.refuses:
            return None
        self.asked.append((start_s, end_s, exposure_s, gain))
        return len(self.asked) - 1


@dataclass(slots=True)
class Memory:
    """An outlet: what a client would see mapped, and who was woken."""

    slots: dict[int, bytes] = field(default_factory=dict)
    woken: list[int | None] = field(default_factory=list)

    def store(self, offset_bytes: int, frame: bytes) -> None:
        self.slots[offset_bytes] = frame

    def wake(self, frame_of: int | None) -> None:
        self.woken.append(frame_of)


class Bench:
    """A camera of 64×48 px at 10 Hz, with one client that has it open."""

    def __init__(self, config: CameraConfig | None = None) -> None:
        self.clock, self.source, self.memory = ManualClock(), Exposures(), Memory()
        self.config = config or CameraConfig(sizes_px=((64, 48), (32, 24)), rates_hz=(20, 10))
        self.device = V4l2Device(self.source, self.clock, self.config)
        self.device.attach(self.memory)
        self.handle, self.client = self.open()

    def open(self, *, is_blocking: bool = False) -> tuple[int, Client]:
        """Open the camera once more."""
        number = self.device.open()
        return number, Client(
            lambda request, data: self.device.ioctl(number, request, data, is_blocking=is_blocking)
        )

    def at(self, world_s: float) -> float | None:
        """Let the world reach an instant; return when the device wants to be called again."""
        self.clock.world_s = world_s
        return self.device.advance(world_s)

    def deliver(self, ticket: int, level: int = 100) -> None:
        """Bring the picture of a ticket: all pixels alike."""
        self.device.deliver(ticket, self.picture(level))

    def picture(self, level: int) -> Picture:
        width, height = self.config.sizes_px[0]
        return np.full((height, width), level, np.uint8)

    @property
    def bits(self) -> int:
        """What poll says."""
        return self.device.poll(self.handle)
