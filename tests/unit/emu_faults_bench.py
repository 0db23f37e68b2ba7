"""An emulated cell in this process: no sockets, no pictures, time by hand."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from emu_camera_bench import Exposures, ManualClock

from emulators.camera_v4l2 import CameraConfig, V4l2Device
from emulators.in_process import Cell, CellOptions, Verbs

ROOT = Path(__file__).parents[2]
BYTE_S = 10 / 9600  # umi_rtx.md 1.2
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
BLOCK_MM = (60.0, 40.0, 20.0)
AT_REST_MM = (350.0, 20.0)


@dataclass
class Connection:
    """A line of a network that counts how often it was cut."""

    is_reachable: bool = True
    cut_count: int = 0

    def drop_connections(self) -> None:
        self.cut_count += 1


@dataclass
class Plugs:
    """The plugs of cameras without a wire."""

    cameras: dict[str, V4l2Device] = field(default_factory=dict)

    def unplug(self, name: str) -> None:
        self.cameras[name].unplug()

    def plug(self, name: str) -> str:
        self.cameras[name].plug()
        return f"unix:{name}"


class StillCell(Cell):
    """A cell that was never started."""

    file = CELL

    def __init__(self, folder: Path, seed: int = 1, as_built: int | None = None) -> None:
        block = folder / "block.stl"
        if not block.exists():
            trimesh.creation.box(BLOCK_MM).export(block)
        at = (*AT_REST_MM, 0.0)
        options = CellOptions(
            cell=self.file, parts=(block,), seed=seed, rest=0, at=at, as_built=as_built
        )
        super().__init__(options, folder)
        self._origin_s = self.world.time_s
        self.eyes = ManualClock()
        config = CameraConfig(sizes_px=((64, 48),), rates_hz=(10,))
        self.cameras = {"overhead": V4l2Device(Exposures(), self.eyes, config)}
        self.camera_plugs = Plugs(self.cameras)
        self.io_network = Connection()
        self.networks = {"io": self.io_network}  # type: ignore[dict-item]  # no socket here

    @property
    def verbs(self) -> Verbs:
        return self.faults

    def pass_time(self, seconds: float) -> None:
        """Let everything live on [world s]."""
        for _ in range(round(seconds / self.step_s)):
            self.advance()

    def hold_block(self) -> None:
        """Put the block between the fixed gripper's pads, and close them on it."""
        self.jaws.opening_mm = BLOCK_MM[2] + 1.0
        self.world.advance(1.0 / 240.0)
        T = np.eye(4)
        T[:3, 3] = self.layout.fixed_gripper.T_world_tcp[:3, 3] - (0.0, 10.0, 0.0)
        self.world.place(0, T)
        self.jaws.drive(0.0, 150.0, 60.0)
        self.pass_time(0.3)
        assert self.world.fixed_gripper.hold is not None

    def arm_reply(self, request: bytes) -> bytes:
        """Return all that the arm's line gives back within a second."""
        now_s = self.world.time_s
        self.rtx.wire.feed(request, now_s)
        return self.rtx.wire.due(now_s + 1.0)

    def arm_reply_by(self, request: bytes, seconds: float) -> bytes:
        """Return what has come back so long after the request."""
        now_s = self.world.time_s + 10.0
        self.rtx.wire.feed(request, now_s)
        return self.rtx.wire.due(now_s + len(request) * BYTE_S + seconds)

    def centre_mm(self) -> Any:
        return self.world.parts[0].centre_mm
