"""Held parts before the station's camera, for the inspection benches.

Pictures are made by the emulated world's own picture maker; the judge gets the pictures and the
cell's nominal data, and the pose and the hold with errors as an arm and a gripper make them.
"""

import itertools
import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import cv2  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402
import trimesh  # noqa: E402
from bench import EMULATED  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from controller.cad import Solid, SurfaceSamples, load_solid, sample_surface  # noqa: E402
from controller.cell.devices.lamps import STATION_LAMPS  # noqa: E402
from controller.config import load_cell  # noqa: E402
from controller.inspection import (  # noqa: E402
    InspectionLimits,
    PosedPart,
    ViewPictures,
    ViewResult,
    ViewTask,
    WorldBox,
    inspect_view,
)
from controller.setup.layout import build_layout  # noqa: E402
from controller.setup.optics import build_lamps, panel_corners  # noqa: E402
from emulators import world as emulated  # noqa: E402
from emulators.world.pictures.picture import Eye  # noqa: E402
from emulators.world.pictures.sensor import Exposure, blurred, develop  # noqa: E402

Array = NDArray[np.float64]
CELL = EMULATED
STATION = 1  # the camera's number
HOLD_MM, HOLD_DEG = 0.8, 0.8  # how a grip differs from the plan, one standard deviation
VIEW_MM, VIEW_DEG = 0.1, 0.08  # how the arm differs from view to view
cv2.setNumThreads(1)


@dataclass(frozen=True, eq=False)
class Held:
    """A part as the judge knows it."""

    solid: Solid
    samples: SurfaceSamples
    part: PosedPart

    @classmethod
    def load(cls, path: Path) -> "Held":
        """Read a part; lengths in mm where the file names no unit."""
        unit = None if path.name.endswith(".csg.yaml") else "mm"
        return cls.of(load_solid(path, unit=unit))

    @classmethod
    def of(cls, solid: Solid) -> "Held":
        return cls(solid, sample_surface(solid), PosedPart(solid))


def rotation(axis: Array, angle_rad: float) -> Array:
    R, _ = cv2.Rodrigues(np.asarray(axis, float) / np.linalg.norm(axis) * angle_rad)
    return np.asarray(R)


def disturbed(T: Array, pivot: Array, mm: float, deg: float, rng: np.random.Generator) -> Array:
    """Return a pose (4, 4) moved and turned about a world point by normal errors."""
    R = rotation(rng.normal(size=3), np.radians(rng.normal(0.0, deg)))
    out = T.copy()
    out[:3, :3] = R @ T[:3, :3]
    out[:3, 3] = R @ (T[:3, 3] - pivot) + pivot + rng.normal(0.0, mm, 3) / np.sqrt(3)
    return out


def looks() -> Iterator[tuple[Array, bool]]:
    """Return 14 ways to hold a part before the camera, (3, 3) part to world, and if it is square.

    Six square to the part's axes but for some degrees, eight onto its corners.
    """
    for axis, sign in itertools.product(range(3), (1.0, -1.0)):
        yield facing(sign * np.eye(3)[axis]), True
    for signs in itertools.product((1.0, -1.0), repeat=3):
        yield facing(np.array(signs) / np.sqrt(3)), False


def facing(direction: Array) -> Array:
    """Return a turn that shows a part's direction to the station's camera, which looks along +y."""
    up = np.array([0.0, 0, 1]) if abs(direction[2]) < 0.9 else np.array([0.0, 1, 0])
    right = np.cross(up, direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    # towards the camera is -y; x of the world is right in the picture
    return np.stack([right, -direction, up])


def grasps(solid: Solid) -> list[tuple[Array, float]]:
    """Return two grips as T_part_tip with their openings: fingers across the two least extents."""
    low, high = solid.mesh.bounds
    size, middle = high - low, 0.5 * (low + high)
    order = np.argsort(size)
    out = []
    for across, along in ((order[0], order[2]), (order[1], order[2]), (order[0], order[1])):
        if size[across] > 84:
            continue
        T = np.eye(4)
        approach, jaws = -np.eye(3)[along], np.eye(3)[across]
        T[:3, :3] = np.column_stack([approach, jaws, np.cross(approach, jaws)])
        T[:3, 3] = middle + 0.5 * size[along] * np.eye(3)[along] + 12.0 * approach
        out.append((T, float(size[across])))
    return out


class Station:
    """The emulated station with one part in it, and what the controller knows of it."""

    def __init__(
        self, body: trimesh.Trimesh, cell_file: Path = CELL, finish_seed: int | None = None
    ) -> None:
        self._layout = emulated.read_layout(cell_file)
        with tempfile.TemporaryDirectory(prefix="station") as folder:
            path = Path(folder) / "part.stl"
            body.export(path)
            solid = emulated.load_solid(path)
        scene = emulated.build_scene(self._layout, [solid], finish_seed)
        self._scene = scene
        self._eye = Eye(scene, STATION)
        self._overhead: Eye | None = None
        self._lamps = [lamp.name for lamp in scene.lamps]
        self.cell = cell = load_cell(cell_file)
        self.layout = build_layout(cell)
        self.world_arm = self._layout.arm

    def shoot(
        self,
        T: Array,
        T_tcp: Array,
        opening_mm: float,
        lamps: tuple[str, ...],
        seed: int,
        links: Mapping[str, Array] = MappingProxyType({}),
    ) -> ViewPictures:
        """Return the pictures of a part at a pose, in a hand at a pose, with links of the arm."""
        poses = {"part 0": T, "arm gripper": T_tcp, **links}
        for sign, name in ((1.0, "arm finger +"), (-1.0, "arm finger -")):
            finger = T_tcp.copy()
            finger[:3, 3] += sign * 0.5 * opening_mm * T_tcp[:3, 1]
            poses[name] = finger

        def one(lamp: str, number: int) -> NDArray[np.uint8]:
            light = self._eye.picture(poses, {self._lamps.index(lamp): 1.0})
            shot = develop(blurred(light), Exposure(0.010, seed=1000 * seed + number))
            return np.asarray(shot, dtype=np.uint8)

        lit = {lamp: one(lamp, i + 1) for i, lamp in enumerate(lamps)}
        return ViewPictures(backlit=one("station_backlight", 0), lit=lit)

    def shoot_lying(self, T: Array, lamps: tuple[str, ...], seed: int) -> ViewPictures:
        """Return the pictures of a part that lies on the table."""
        if self._overhead is None:
            self._overhead = Eye(self._scene, 0)
        eye = self._overhead

        def one(lamp: str, number: int) -> NDArray[np.uint8]:
            light = eye.picture({"part 0": T}, {self._lamps.index(lamp): 1.0})
            shot = develop(blurred(light), Exposure(0.010, seed=1000 * seed + 500 + number))
            return np.asarray(shot, dtype=np.uint8)

        lit = {lamp: one(lamp, i + 1) for i, lamp in enumerate(lamps)}
        return ViewPictures(backlit=one("table_backlight", 0), lit=lit)

    def task(
        self,
        view_id: str,
        T: Array,
        T_tcp: Array,
        opening_mm: float,
        lamps: tuple[str, ...],
        limits: InspectionLimits,
        is_hold_measured: bool,
    ) -> ViewTask:
        """Return the view as the controller expects it."""
        hand = self.layout.arm_gripper
        boxes = [*hand.body, *hand.fingers(opening_mm)]
        holder = tuple(
            WorldBox(box.T, np.asarray(box.half_mm)) for box in (b.placed(T_tcp) for b in boxes)
        )
        return ViewTask(
            view_id=view_id,
            camera=self.layout.inspection,
            T_world_part_expected=T,
            holder=holder,
            panel_mm=panel_corners(self.cell, "station_backlight"),
            lamps=build_lamps(self.cell, lamps),
            limits=limits,
            is_hold_measured=is_hold_measured,
        )


def judged_views(
    nominal: Held, station: Station, seed: int, limits: InspectionLimits, view_count: int = 14
) -> Iterator[tuple[ViewResult, ViewPictures, ViewTask]]:
    """Yield the views of a held part as they are judged, with their pictures.

    The first half is shown under one grip, the rest under another; each grip is off, and is
    measured by its first view, as in a run.
    """
    rng = np.random.default_rng(seed)
    solid = nominal.solid
    held = grasps(solid)
    every = list(looks())[:view_count]
    centre = solid.centroid_mm
    station_mm = station.layout.station_mm
    slip: Array = np.eye(4)
    known: Array = np.eye(4)
    is_seen, last = False, -1
    for number, (R, is_square) in enumerate(every):
        # the hand comes from where it hides least
        towards = np.array([0.0, -1.0, 0.0]) @ R
        which = int(np.argmin([-(towards @ grasp[0][:3, 0]) for grasp in held]))
        if which != last:
            slip = disturbed(np.eye(4), centre, HOLD_MM, HOLD_DEG, rng)
            known, is_seen, last = np.eye(4), False, which
        T_part_tcp, opening = held[which]
        T = np.eye(4)
        tilt = rotation(rng.normal(size=3), np.radians(rng.uniform(1.0, 6.0)))
        T[:3, :3] = tilt @ R
        T[:3, 3] = station_mm - T[:3, :3] @ centre
        T_tcp = T @ T_part_tcp
        T_true = disturbed(T @ slip, station_mm, VIEW_MM, VIEW_DEG, rng)
        lamps = STATION_LAMPS if is_square else STATION_LAMPS[:1]
        pictures = station.shoot(T_true, T_tcp, opening, lamps, 100 * seed + number)
        task = station.task(f"v{number:02d}", T @ known, T_tcp, opening, lamps, limits, is_seen)
        result = inspect_view(nominal.part, nominal.samples, task, pictures)
        # a pose that a lit picture speaks against is no measured hold
        if result.evaluated and not result.failures:
            known, is_seen = np.linalg.inv(T) @ result.T_world_part_known, True
        yield result, pictures, task
