"""The answers to the cell's questions without pictures: the world's truth, made noisy.

In place of the worker process. A picture's first bytes hold the true pose of the part when it was
taken (`stamped_picture`); the substitutes for recognition and inspection read that. Planning is the
real one, done in this process. Nothing of this is part of the product.
"""

import asyncio
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.cache import digest_of
from controller.cell.compute import Compute, Holder, Job, Located, SeenCode, context
from controller.cell.custody import ALONE, Around
from controller.cell.devices.lamps import STATION_PANEL, TABLE_PANEL
from controller.cell.services import plain_name
from controller.config.view_set import load_view_set, parse_view_set, unpacked
from controller.imaging import Camera, inverse_pose, transform
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    Measured,
    Rim,
    RimGeometry,
)
from controller.planning import FaceToShowAgain, Look, NoPlanError, Plan, Present, Start
from controller.planning.geometry import Box, segments_hit
from controller.recognition import Alternative, Sighting

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Grey = NDArray[np.uint8]

HEADER_BYTES: Final = 18 * 8  # T_world_part, who has it, whether the picture can be used
HOLDERS: Final = ("away", "free", "arm", "fixture", "both")
SEEN_COS: Final = float(np.cos(np.radians(75.0)))  # flattest surface that inspection compares
SLIPPED_MM, SLIPPED_RAD = 4.0, 0.12  # inspection's own limits (`inspecting.InspectionLimits`)
FOUND_MM, FOUND_RAD = 16.0, 0.55  # as far as the search for a slipped part goes
MEASURED_MM, MEASURED_RAD = 0.15, 0.002  # how well a view measures the pose in the gripper
NO_PART: Final = "no part"
SIZE_PX: Final = (1280, 1024)  # size of both cameras, checked on stored pictures

# A value of every judged part, so that what counts values has one to count.
_RIM: Final = Rim(
    np.zeros(3), np.array([0.0, 0.0, 1.0]), 4.0, np.array([1.0, 0.0, 0.0]), 2 * np.pi, 1, 0, True
)
BORE: Final = Measured(
    Characteristic(
        id="d1",
        balloon=1,
        kind=CharacteristicKind.DIAMETER,
        label="bore 8.0 mm",
        nominal_mm=8.0,
        lower_mm=7.9,
        upper_mm=8.1,
        source="stand-in",
        geometry=RimGeometry((_RIM,)),
        faces=(1,),
    ),
    8.01,
    0.02,
    inspecting.Verdict.PASS,
    (),
    "",
)


def stamped_picture(
    T_world_part: Array | None,
    custody: str,
    *further: tuple[Array | None, str],
    is_dark: bool = False,
) -> Grey:
    """Return a picture that holds each part's pose.

    Parameters
    ----------
    T_world_part : (4, 4) pose of the first part, None for one that is away
    custody : holder of it, one of `HOLDERS`
    further : the same of further parts
    is_dark : no light reached the sensor, so that the picture shows nothing
    """
    image = np.full(SIZE_PX[::-1], 0 if is_dark else 255, np.uint8)
    for number, (T, holder) in enumerate(((T_world_part, custody), *further)):
        where = (np.eye(4) if T is None else T).ravel()
        numbers = np.concatenate([where, [float(HOLDERS.index(holder)), float(is_dark)]])
        stamp = np.frombuffer(numbers.tobytes(), np.uint8)
        image.ravel()[number * HEADER_BYTES : (number + 1) * HEADER_BYTES] = stamp
    return image


def read_truth(picture: Grey, number: int = 0) -> tuple[Array, str]:
    """Return T_world_part (4, 4) and who had a part by its number; ``away`` of a dark picture."""
    stamp = picture.ravel()[number * HEADER_BYTES : (number + 1) * HEADER_BYTES]
    numbers = np.frombuffer(stamp.tobytes(), np.float64)
    custody = "away" if numbers[17] else HOLDERS[int(numbers[16])]
    return numbers[:16].reshape(4, 4).copy(), custody


@dataclass(frozen=True, slots=True)
class TruthFrame:
    """Such a picture as a camera's frame (`drivers.kinds.camera`)."""

    image: Grey
    white: int = 255


@dataclass(slots=True)
class Seen:
    """One view as judged.

    Attributes
    ----------
    samples, promised : (n,) bool, what it showed, and what the plan wanted of it
    is_first_of_hold : True if it had to prove the hold by sight
    is_after_recovery : the cell had recovered from something before
    """

    view: str
    samples: Mask
    promised: Mask
    is_first_of_hold: bool
    is_after_recovery: bool


@dataclass(slots=True)
class Noise:
    """The errors of recognition: one standard deviation of x and y, and of theta."""

    place_mm: float = 1.0
    turn_rad: float = float(np.radians(2.0))


class StandIns(Compute):
    """The worker process, without pictures.

    Parameters
    ----------
    job : recipe and cell
    pool : for what is really computed; ignored by a loop that has no processes
    noise : noise of recognition
    rng : draws it
    planned : poses (4, 4) of which plans are kept: a part this near to one, within the noise, is
        recognised exactly there
    takes_s : range of the worker's time for a question, from and to [s]; no delay where not named
    number : number of the recipe's part in the world

    Attributes
    ----------
    views : views that were judged
    beside : the same for the other recipes of the batch: their parts are seen on the table, too
    """

    def __init__(
        self,
        job: Job,
        pool: Executor,
        noise: Noise,
        rng: np.random.Generator,
        planned: tuple[Array, ...] = (),
        takes_s: Mapping[str, tuple[float, float]] = MappingProxyType({}),
        number: int = 0,
    ) -> None:
        super().__init__(job, pool)
        self._context = context(job)
        self._noise = noise
        self._rng = rng
        self._planned = planned
        self._takes_s = takes_s
        self.views: list[Seen] = []
        self.beside: tuple[StandIns, ...] = ()
        self._number = number
        self.has_recovered = False
        self._promised: dict[str, Mask] = {}
        self._located: dict[str, Located] = {}

    async def _take(self, question: str) -> None:
        if question in self._takes_s:
            await asyncio.sleep(float(self._rng.uniform(*self._takes_s[question])))

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
        alternatives: tuple[Alternative, ...],
        around: Around = ALONE,
        short: frozenset[FaceToShowAgain] = frozenset(),
    ) -> Plan:
        """Return the planner's plan; of one start it is made once."""
        await self._take("plan")
        key = digest_of(
            str(self.job.recipe_path),
            start,
            seen,
            tuple(sorted(avoid)),
            repr(around),
            repr(sorted((one.grasp, one.face) for one in short)),
        )
        found = _plans.pop(key, None)
        if found is None:
            try:
                found = await super().plan(start, seen, avoid, alternatives, around, short)
            except NoPlanError as error:
                found = str(error)
            if len(_plans) >= MAX_PLANS:
                _plans.pop(next(iter(_plans)))
        _plans[key] = found  # the one used last comes last
        if isinstance(found, str):
            raise NoPlanError(found)
        looks = [s for s in found.steps if isinstance(s, Present | Look)]
        self._promised |= {step.view_id: step.seen for step in looks}
        return found

    async def prepare(self) -> float:
        """Prepare the part; how long that took is not the same every time, and not returned."""
        await self._take("prepare")
        await super().prepare()
        return 0.0

    async def identify(self, *_: object) -> tuple[int, ...]:
        """Raise: these runs read every part without a doubt."""
        raise AssertionError("a doubt about a part that was read without one")

    async def recognise(self, backlit: Grey, lit: Mapping[str, Grey]) -> tuple[Sighting, ...]:
        """Return the true places of parts, with noise; none outside the camera's picture."""
        await self._take("recognise")
        found = (one.sighted(backlit) for one in (self, *self.beside))
        return tuple(one for one in found if one is not None)

    def sighted(self, backlit: Grey) -> Sighting | None:
        """Return the true place of the recipe's part, with noise; None if it is not seen."""
        T, custody = read_truth(backlit, self._number)
        c = self._context
        centre = transform(T, c.solid.centroid_mm[None])[0]
        width, height = c.overhead.size_px
        u, v = c.overhead.project(centre[None])[0]
        if custody != "free" or not (0 <= u < width and 0 <= v < height):
            return None
        noisy = self._kept_near(T)
        if noisy is None:
            dx, dy = self._rng.normal(0.0, self._noise.place_mm, 2)
            noisy = turned_about(T, centre, self._rng.normal(0.0, self._noise.turn_rad))
            noisy[:2, 3] += (dx, dy)
        centre = transform(noisy, c.solid.centroid_mm[None])[0]
        down = T[:3, :3].T @ [0.0, 0.0, -1.0]
        angles = [float(np.arccos(np.clip(-down @ pose.R[2], -1, 1))) for pose in c.poses]
        nearest = int(np.argmin(angles))
        # a part that rolls on a curve lies on any line of it
        lies = angles[nearest] < np.radians(8.0) or any(p.rolling or p.rocking for p in c.poses)
        pose = c.poses[nearest]
        return Sighting(
            part=c.solid.name,
            pose_index=pose.index if lies else -1,
            R=noisy[:3, :3],
            x_mm=float(centre[0]),
            y_mm=float(centre[1]),
            theta_rad=float(np.arctan2(noisy[1, 0], noisy[0, 0])),
            T_world_part=noisy,
            score=1.0,
            covariance=None,
            ambiguous_with=(),
            area_mm2=0.0,
            box_px=(0, 0, 1, 1),
            residual_px=float("inf"),
        )

    def _kept_near(self, T: Array) -> Array | None:
        """Return the pose with a kept plan that recognition, with its noise, may read."""
        for kept in self._planned:
            shift, turn = self._off(T, kept)
            if shift < 4.0 * self._noise.place_mm and turn < 4.0 * self._noise.turn_rad:
                return kept.copy()
        return None

    async def locate(
        self,
        view_id: str,
        T_world_part: Array,
        holder: Holder,
        backlit: Grey,
        lit: Mapping[str, Grey],
        is_hold_measured: bool,
        facts: inspecting.PartFacts = inspecting.NO_FACTS,
    ) -> Located:
        """Return the part's place in the picture, if it is near the expected one."""
        await self._take("locate")
        T, custody = read_truth(backlit, self._number)
        shift, turn = self._off(T, T_world_part)
        reason = ""
        if custody != "arm":
            reason = "no outline of the part where it should be"
        elif shift > SLIPPED_MM or turn > SLIPPED_RAD:
            reason = f"part lies {shift:.1f} mm, {np.degrees(turn):.1f} degrees off: it slipped"
        found = Located(not reason, reason, T_world_part if reason else self._measured(T))
        self._located[view_id] = found
        return found

    async def inspect(
        self,
        view_id: str,
        T_world_part: Array,
        holder: Holder,
        backlit: Grey,
        lit: Mapping[str, Grey],
        is_hold_measured: bool,
        facts: inspecting.PartFacts = inspecting.NO_FACTS,
    ) -> inspecting.ViewResult:
        """Return the view of the part at its true place in the gripper."""
        await self._take("inspect")
        where = self._located.pop(view_id, None) or await self.locate(
            view_id, T_world_part, holder, backlit, lit, is_hold_measured
        )
        T, _ = read_truth(backlit, self._number)
        shift, turn = self._off(T, T_world_part)
        count = len(self._context.samples.points_mm)
        reason, seen = where.reason, np.zeros(count, dtype=bool)
        if where.evaluated:
            seen = await asyncio.to_thread(self._in_sight, T, holder, self._context.inspection)
            planned = self._promised.get(plain_name(view_id), np.zeros(count, dtype=bool))
            self.views.append(
                Seen(view_id, seen, planned, not is_hold_measured, self.has_recovered)
            )
        found = _result_of(view_id, T_world_part, where.T_world_part, reason, seen)
        return found if reason else replace(found, shift_mm=shift, turn_rad=turn)

    async def inspect_on_table(
        self,
        view_id: str,
        T_world_part: Array,
        backlit: Grey,
        lit: Mapping[str, Grey],
        facts: inspecting.PartFacts = inspecting.NO_FACTS,
    ) -> inspecting.ViewResult:
        """Return the table camera's view of the part at its true place."""
        await self._take("inspect")
        T, custody = read_truth(backlit, self._number)
        is_there = custody == "free"
        count = len(self._context.samples.points_mm)
        seen = np.zeros(count, dtype=bool)
        if is_there:
            seen = await asyncio.to_thread(self._in_sight, T, (), self._context.overhead)
            planned = self._promised.get(plain_name(view_id), np.zeros(count, dtype=bool))
            self.views.append(Seen(view_id, seen & planned, planned, True, self.has_recovered))
        return _result_of(view_id, T_world_part, T, "" if is_there else NO_PART, seen)

    async def read_codes(
        self, pictures: tuple[Grey, ...], T_world_part: Array, *, is_held: bool
    ) -> tuple[SeenCode, ...]:
        """Return no code: these pictures show none."""
        await self._take("inspect")
        return ()

    async def find_hold(
        self,
        T_world_part: Array,
        T_part_tcp: Array,
        holder: Holder,
        backlit: Grey,
    ) -> Array | None:
        """Return the part's true pose, if it is within the range of the real search."""
        await self._take("inspect")
        T, custody = read_truth(backlit, self._number)
        shift, turn = self._off(T, T_world_part)
        if custody != "arm" or shift > FOUND_MM or turn > FOUND_RAD:
            return None
        return self._measured(T)

    async def judge_ahead(
        self,
        set_path: Path,
        text: str,
        view_count: int,
    ) -> bool:
        """Read the views to judge ahead, as the worker process does; no work is left to do."""
        await self._take("judge_ahead")
        assert parse_view_set(set_path, text).views
        return False

    async def judge(self, set_path: Path) -> inspecting.PartInspection:
        """Return the verdict on a good part by how much of what was planned was in sight."""
        await self._take("judge")
        c = self._context
        count = len(c.samples.points_mm)
        seen, planned = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        results = []
        file = load_view_set(set_path)
        for view in file.views:
            is_held = view.camera is None
            picture = view.pictures[STATION_PANEL if is_held else TABLE_PANEL]
            stored = cv2.imread(str(set_path.parent / picture), cv2.IMREAD_GRAYSCALE)
            T, custody = read_truth(np.asarray(stored, dtype=np.uint8), self._number)
            boxes = tuple(
                inspecting.WorldBox(np.array(b.T), np.array(b.half_mm)) for b in view.gripper_boxes
            )
            compared, reason = np.zeros(count, dtype=bool), NO_PART
            if custody == ("arm" if is_held else "free"):
                compared = self._in_sight(T, boxes, c.inspection if is_held else c.overhead)
                reason = ""
            seen |= compared
            if view.planned is not None:
                planned |= unpacked(view.planned, count)
            results.append(_result_of(view.id, T, T, reason, compared))
        can_be_seen = seen | planned
        share = float(self.weights[seen].sum() / max(self.weights[can_be_seen].sum(), 1e-9))
        enough = share >= c.recipe.inspection.min_coverage
        verdict = inspecting.Verdict.PASS if enough else inspecting.Verdict.INDETERMINATE
        reason = f"{100 * share:.0f} % of what was planned was in sight"
        ledger = inspecting.PartVerdict(verdict, (reason,), (), share, (), share, "a good part")
        off = tuple(inspecting.ViewOff(f"V{i}", 0, MEASURED_MM, MEASURED_RAD) for i in range(3))
        return inspecting.PartInspection(
            verdict, (reason,), tuple(results), (BORE,), (), ledger, off=off
        )

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


MAX_PLANS: Final = 64  # a few of each scene; more would look like a leak in a soak
_plans: dict[str, Plan | str] = {}  # by start: a plan, or why there is none


def _result_of(
    view_id: str, T_expected: Array, T_measured: Array, reason: str, compared: Mask
) -> inspecting.ViewResult:
    """Return a view's result without findings; it is not evaluated where there is a reason."""
    return inspecting.ViewResult(
        view_id=view_id,
        evaluated=not reason,
        reason=reason,
        T_world_part_expected=T_expected,
        T_world_part_measured=None if reason else T_measured,
        shift_mm=0.0,
        turn_rad=0.0,
        residual_px=0.1,
        findings=(),
        compared=compared,
        outline_px=np.zeros((0, 2)),
    )


def _rotation(axis: Array, angle_rad: float) -> Array:
    k = axis / np.linalg.norm(axis)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    R: Array = np.eye(3) + np.sin(angle_rad) * K + (1 - np.cos(angle_rad)) * (K @ K)
    return R


def turned_about(T: Array, centre: Array, angle_rad: float) -> Array:
    """Return a pose turned about a vertical axis through a point."""
    R = _rotation(np.array([0.0, 0.0, 1.0]), angle_rad)
    out = T.copy()
    out[:3, :3] = R @ T[:3, :3]
    out[:3, 3] = centre + R @ (T[:3, 3] - centre)
    return out
