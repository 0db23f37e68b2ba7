"""Who answers the cell's questions in `bench_runs.py`: the emulated world's truth, made noisy.

Handed to the controller's own dispatcher and actions in place of the worker process; planning is
the real one, in the worker process. A picture is not rendered: its first bytes say where the part
truly was when it was taken, and the stand-ins for recognition and inspection read that. Nothing of
this is part of the product, and nothing of the product knows it.
"""

import asyncio
import json
import re
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.cell.compute import Compute, Holder, Job, context
from controller.imaging import Camera, inverse_pose, transform
from controller.inspection import Verdict
from controller.planning import Look, Plan, Present, Start
from controller.planning.geometry import Box, segments_hit
from controller.recognition import Alternative, Sighting
from drivers.clock import CellClock

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Grey = NDArray[np.uint8]

HEADER_BYTES = 17 * 8  # T_world_part and who has it
HOLDERS = ("away", "free", "arm", "fixture", "both")
SEEN_COS = float(np.cos(np.radians(75.0)))  # as flat as inspection compares a surface
SLIPPED_MM, SLIPPED_RAD = 4.0, 0.12  # inspection's own limits (`inspecting.InspectionLimits`)
FOUND_MM, FOUND_RAD = 16.0, 0.55  # as far as the search for a slipped part goes
MEASURED_MM, MEASURED_RAD = 0.15, 0.002  # how well a view measures the pose in the hand
FRAME_S = 0.26  # a period of 5 Hz, the exposure, and its transfer


class World:
    """The control port of the emulated cell, asked from asyncio."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = asyncio.Lock()
        self._line: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def __call__(self, do: str, **order: object) -> dict[str, Any]:
        """Send an order, return the answer; RuntimeError if it was refused."""
        async with self._lock:
            if self._line is None:
                self._line = await asyncio.open_unix_connection(str(self._path), limit=1 << 24)
            reader, writer = self._line
            writer.write(json.dumps({"do": do, **order}).encode() + b"\n")
            await writer.drain()
            answer = json.loads(await reader.readline())
        if not answer.pop("ok"):
            raise RuntimeError(answer["error"])
        return dict(answer)

    async def aclose(self) -> None:
        """Hang up."""
        if self._line is not None:
            self._line[1].close()
            self._line = None


@dataclass(frozen=True, slots=True)
class _Frame:
    image: Grey
    white: int = 255


class TruthCamera:
    """In place of a camera's driver: takes a frame's time, and notes the truth in the picture."""

    def __init__(self, world: World, clock: CellClock) -> None:
        self._world = world
        self._clock = clock
        self.is_paused = False

    async def connect(self) -> None:
        """Nothing to open."""

    async def close(self) -> None:
        """Nothing to close."""

    async def pause(self) -> None:
        """As the driver."""
        self.is_paused = True

    async def resume(self) -> None:
        """As the driver."""
        self.is_paused = False

    model = "no camera: truth with noise"

    def identity(self) -> Any:  # noqa: ANN401 - duck-typed
        """Say what this is."""

        class _Identity:
            card, driver = "no camera: truth with noise", "bench"

        return _Identity()

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> _Frame:
        """Return a white picture whose first bytes tell where the part is."""
        await self._clock.sleep(FRAME_S)
        part = (await self._world("truth"))["parts"][0]
        T = np.eye(4) if part["T_world_part"] is None else np.array(part["T_world_part"])
        numbers = np.append(T.ravel(), float(HOLDERS.index(part["custody"])))
        image = np.full((64, 64), 255, np.uint8)
        image.ravel()[:HEADER_BYTES] = np.frombuffer(numbers.tobytes(), np.uint8)
        return _Frame(image)


def _planned_name(view_id: str) -> str:
    """Return a view's name in its plan: views of later plans end in that plan's number."""
    return re.sub(r"~\d+$", "", view_id)


def read_truth(picture: Grey) -> tuple[Array, str]:
    """Return T_world_part (4, 4) and who had the part when a picture was taken."""
    numbers = np.frombuffer(picture.ravel()[:HEADER_BYTES].tobytes(), np.float64)
    return numbers[:16].reshape(4, 4).copy(), HOLDERS[int(numbers[16])]


@dataclass(slots=True)
class Seen:
    """One view as it was judged.

    Attributes
    ----------
    samples, promised : (n,) bool, what it showed, and what the plan wanted of it
    is_first_of_hold : it had to prove the hold by sight
    is_after_recovery : the cell had got over some trouble before
    """

    view: str
    samples: Mask
    promised: Mask
    is_first_of_hold: bool
    is_after_recovery: bool


@dataclass(slots=True)
class Noise:
    """How far off recognition is: one standard deviation of x and y, and of theta."""

    place_mm: float = 1.0
    turn_rad: float = float(np.radians(2.0))


class StandIns(Compute):
    """The worker process, except for what needs pictures."""

    def __init__(self, job: Job, pool: Executor, noise: Noise, rng: np.random.Generator) -> None:
        super().__init__(job, pool)
        self._context = context(job)
        self._noise = noise
        self._rng = rng
        self.views: list[Seen] = []
        self.plan_wall_s: list[float] = []
        self.has_recovered = False
        self._promised: dict[str, Mask] = {}

    @property
    def weights(self) -> Array:
        """Each sample's share of the surface (n,)."""
        areas = self._context.samples.areas_mm2
        return np.asarray(areas / areas.sum())

    async def plan(
        self,
        start: Start,
        seen: Mask | None,
        avoid: frozenset[str],
        candidates: tuple[Alternative, ...],
    ) -> Plan:
        """Return the worker's plan, and note how long it took."""
        started = time.monotonic()
        try:
            plan = await super().plan(start, seen, avoid, candidates)
        finally:
            self.plan_wall_s.append(time.monotonic() - started)
        looks = [s for s in plan.steps if isinstance(s, Present | Look)]
        self._promised |= {step.view_id: step.seen for step in looks}
        return plan

    async def identify(self, *_: object) -> tuple[int, ...]:
        """These runs read every part without a doubt."""
        raise AssertionError("a doubt about a part that was read without one")

    async def recognise(self, backlit: Grey, lit: Mapping[str, Grey]) -> tuple[Sighting, ...]:
        """Return where the part truly lies, with noise; nothing outside the camera's picture."""
        T, custody = read_truth(backlit)
        c = self._context
        centre = transform(T, c.solid.centroid_mm[None])[0]
        width, height = c.overhead.size_px
        u, v = c.overhead.project(centre[None])[0]
        if custody != "free" or not (0 <= u < width and 0 <= v < height):
            return ()
        dx, dy = self._rng.normal(0.0, self._noise.place_mm, 2)
        turn = self._rng.normal(0.0, self._noise.turn_rad)
        noisy = _turned_about(T, centre, turn)
        noisy[:2, 3] += (dx, dy)
        down = T[:3, :3].T @ [0.0, 0.0, -1.0]
        angles = [float(np.arccos(np.clip(-down @ pose.R[2], -1, 1))) for pose in c.poses]
        nearest = int(np.argmin(angles))
        # a part that rolls on a curve lies on any line of it
        lies = angles[nearest] < np.radians(8.0) or any(p.rolling or p.rocking for p in c.poses)
        pose = c.poses[nearest]
        return (
            Sighting(
                part=c.solid.name,
                pose_index=pose.index if lies else -1,
                R=noisy[:3, :3],
                x_mm=float(centre[0] + dx),
                y_mm=float(centre[1] + dy),
                theta_rad=float(np.arctan2(noisy[1, 0], noisy[0, 0])),
                T_world_part=noisy,
                score=1.0,
                covariance=None,
                ambiguous_with=(),
                area_mm2=0.0,
                box_px=(0, 0, 1, 1),
                residual_px=float("inf"),
            ),
        )

    async def inspect(
        self,
        view_id: str,
        T_world_part: Array,
        holder: Holder,
        backlit: Grey,
        lit: Mapping[str, Grey],
        is_hold_measured: bool,
    ) -> inspecting.ViewResult:
        """Return what the camera sees of the part where it truly is in the hand."""
        T, custody = read_truth(backlit)
        shift, turn = self._off(T, T_world_part)
        count = len(self._context.samples.points_mm)
        reason, seen = "", np.zeros(count, dtype=bool)
        if custody != "arm":
            reason = "no outline of the part where it should be"
        elif shift > SLIPPED_MM or turn > SLIPPED_RAD:
            reason = f"part lies {shift:.1f} mm, {np.degrees(turn):.1f} degrees off: it slipped"
        else:
            seen = await asyncio.to_thread(self._in_sight, T, holder, self._context.inspection)
            planned = self._promised[_planned_name(view_id)]
            self.views.append(
                Seen(view_id, seen, planned, not is_hold_measured, self.has_recovered)
            )
        return inspecting.ViewResult(
            view_id=view_id,
            evaluated=not reason,
            reason=reason,
            T_world_part=T_world_part if reason else self._measured(T),
            shift_mm=0.0 if reason else shift,
            turn_rad=0.0 if reason else turn,
            residual_px=0.1,
            findings=(),
            compared=seen,
            outline_px=np.zeros((0, 2)),
        )

    async def inspect_on_table(
        self, view_id: str, T_world_part: Array, backlit: Grey, lit: Mapping[str, Grey]
    ) -> inspecting.ViewResult:
        """Return what the camera over the table sees of the part where it truly lies."""
        T, custody = read_truth(backlit)
        is_there = custody == "free"
        count = len(self._context.samples.points_mm)
        seen = np.zeros(count, dtype=bool)
        if is_there:
            seen = await asyncio.to_thread(self._in_sight, T, (), self._context.overhead)
            planned = self._promised[_planned_name(view_id)]
            self.views.append(Seen(view_id, seen & planned, planned, True, self.has_recovered))
        return inspecting.ViewResult(
            view_id=view_id,
            evaluated=is_there,
            reason="" if is_there else "no part",
            T_world_part=T,
            shift_mm=0.0,
            turn_rad=0.0,
            residual_px=0.1,
            findings=(),
            compared=seen,
            outline_px=np.zeros((0, 2)),
        )

    async def judge(self, set_path: Path) -> inspecting.PartInspection:
        """Return a pass on what was in sight: nobody looks for defects here."""
        seen = np.logical_or.reduce([view.samples for view in self.views])
        share = float(self.weights[seen].sum())
        ledger = inspecting.PartVerdict(Verdict.PASS, ("stood in for",), (), share, (), share)
        return inspecting.PartInspection(Verdict.PASS, ("stood in for",), (), (), (), ledger)

    async def find_hold(
        self,
        T_world_part: Array,
        T_part_tcp: Array,
        holder: Holder,
        backlit: Grey,
    ) -> Array | None:
        """Return where the part truly is, if that is within what the real search tries."""
        T, custody = read_truth(backlit)
        shift, turn = self._off(T, T_world_part)
        if custody != "arm" or shift > FOUND_MM or turn > FOUND_RAD:
            return None
        return self._measured(T)

    def _off(self, T: Array, T_expected: Array) -> tuple[float, float]:
        moved = T[:3, :3] @ T_expected[:3, :3].T
        turn = float(np.arccos(np.clip((np.trace(moved) - 1) / 2, -1.0, 1.0)))
        centre = self._context.solid.centroid_mm[None]
        return float(np.linalg.norm(transform(T, centre) - transform(T_expected, centre))), turn

    def _measured(self, T: Array) -> Array:
        axis = self._rng.normal(size=3)
        out = T.copy()
        out[:3, :3] = _rotation(axis, self._rng.normal(0.0, MEASURED_RAD)) @ T[:3, :3]
        centre = self._context.solid.centroid_mm
        out[:3, 3] = T[:3, :3] @ centre + T[:3, 3] - out[:3, :3] @ centre
        out[:3, 3] += self._rng.normal(0.0, MEASURED_MM, 3)
        return out

    def _in_sight(self, T: Array, holder: Holder, camera: Camera) -> Mask:
        """Return the samples (n,) nothing stands before, as flat as inspection still compares."""
        c = self._context
        points = transform(T, c.samples.points_mm)
        normals = c.samples.normals @ T[:3, :3].T
        towards = camera.position_mm - points
        unit = towards / np.linalg.norm(towards, axis=1)[:, None]
        pixels = camera.project(points)
        width, height = camera.size_px
        seen: Mask = (unit * normals).sum(axis=1) > SEEN_COS
        seen &= (pixels[:, 0] >= 0) & (pixels[:, 0] < width)
        seen &= (pixels[:, 1] >= 0) & (pixels[:, 1] < height)
        index = np.flatnonzero(seen)
        start = points[index] + 0.05 * normals[index]
        back = inverse_pose(T)
        hidden = c.posed.caster.blocked(transform(back, start), unit[index] @ T[:3, :3])
        boxes = [Box(box.T, np.asarray(box.half_mm)) for box in holder]
        hidden |= segments_hit(start, camera.position_mm, boxes)
        seen[index[hidden]] = False
        return seen


def _rotation(axis: Array, angle_rad: float) -> Array:
    k = axis / np.linalg.norm(axis)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    R: Array = np.eye(3) + np.sin(angle_rad) * K + (1 - np.cos(angle_rad)) * (K @ K)
    return R


def _turned_about(T: Array, centre: Array, angle_rad: float) -> Array:
    R = _rotation(np.array([0.0, 0.0, 1.0]), angle_rad)
    out = T.copy()
    out[:3, :3] = R @ T[:3, :3]
    out[:3, 3] = centre + R @ (T[:3, 3] - centre)
    return out
