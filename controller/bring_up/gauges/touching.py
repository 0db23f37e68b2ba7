"""The arm's fingers about the plate in the fixed gripper: the places, the ways in, and the touch.

The plate stands out of the fixed jaws. The arm's open jaws come over it from its free end along
straight lines, and close slowly off its middle until the tip of one finger touches a face of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, sin
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.grippers import Touch
from controller.planning.geometry import Box
from controller.planning.model import CellLayout
from controller.planning.motion import (
    Scene,
    fewest_waypoints,
    inverse_rows,
    same_branch,
    tcp_pose,
)
from messages import say

from ..bench import SLOW, Bench, with_clearance
from ..errors import StepFailedError

OPEN_MM: Final = 56.0  # opening of the arm's jaws about the plate
OFF_MM: Final = 10.0  # offset of their middle from the plate's, above any error of the cell file
TILT_RAD: Final = float(np.radians(3.0))  # above any inclination of fingers and plate
# distances of the tips from the fixed gripper's tips; the inner one as far as the palm lets them
OUTER_MM: Final = 80.0
INNER_MM: Final = 34.0
ACROSS_MM: Final = (-26.0, 26.0)
AHEAD_MM: Final = 30.0  # distance before the plate's end at which the jaws are clear of it
TURNS_RAD: Final = tuple(np.radians([0.0, 20.0, -20.0, 40.0, -40.0]).tolist())
UNMEASURED_MM: Final = 8.0  # added to unmeasured obstacles once the arm is calibrated
PLATE_MM: Final = (10.0, 8.0, 10.0)  # largest reach of the plate beyond its expected box
MARGIN_MM: Final = 3.0
CLEAR_MM: Final = 6.0  # from the plate's end to the palm: the margin, and a tilted palm's edge
STEP_MM: Final = 4.0  # distance between waypoints along a line
TOUCH_FORCE: Final = 20  # MAX_FORCE of the jaws, the least that has been used (umi_rtx.md 5.6)
TOUCH_SPEED: Final = 0.2  # share of the speed at which they close on a part
MET_MM: Final = 3.0  # jaws that stop within this of the plate's thickness have met both faces


@dataclass(frozen=True, slots=True)
class JawsPlace:
    """The place of the arm's jaws about the plate, in the fixed gripper's frame.

    Attributes
    ----------
    along_mm, off_mm, across_mm : distances of the tips: along the plate, off it and across it
    tilt_rad : tilt of the approach, towards the fixed gripper's +y
    turn_rad : turn of the approach, about its y
    flip : 1 or -1: the arm's y is along its y, or against it
    """

    along_mm: float
    off_mm: float
    across_mm: float
    tilt_rad: float
    turn_rad: float
    flip: int

    def pose(self) -> FloatArray:
        """Return (4, 4) of the arm's TCP in the fixed gripper's frame."""
        level = cos(self.tilt_rad)
        x = np.array([-level * cos(self.turn_rad), sin(self.tilt_rad), -level * sin(self.turn_rad)])
        y = np.array([0.0, float(self.flip), 0.0])
        y -= x * (x @ y)
        y /= np.linalg.norm(y)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
        T[:3, 3] = self.along_mm, self.off_mm, self.across_mm
        return T

    def touching(self, along_mm: float, face: int) -> "JawsPlace":
        """Return the place from where a finger touches a face, 1 or -1 along y."""
        # the other finger is farther off, and the tip comes first
        return JawsPlace(
            along_mm, -face * OFF_MM, self.across_mm, -face * TILT_RAD, self.turn_rad, self.flip
        )


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A way in along the plate, touching as it goes, and out again.

    Attributes
    ----------
    q_ready : (6,) joints before the plate's end, with the jaws clear of it
    lines : joints (k, 6) of each straight line, the last one out again
    touches : place and face of the touch after each line but the last
    """

    q_ready: FloatArray
    lines: tuple[FloatArray, ...]
    touches: tuple[tuple[JawsPlace, int], ...]


def plate_in_fixed(thickness_mm: float, size_mm: tuple[float, float], end_mm: float) -> Box:
    """Return the largest box that a held plate may occupy, in the fixed gripper's frame.

    Parameters
    ----------
    thickness_mm : thickness of the plate
    size_mm : its height, along the approach, and its width
    end_mm : position of its free end
    """
    height_mm, width_mm = size_mm
    T = np.eye(4)
    T[0, 3] = end_mm - height_mm / 2.0
    return Box(T, np.array([height_mm, thickness_mm, width_mm]) / 2.0 + np.array(PLATE_MM))


def scene_about(layout: CellLayout, plate: Box, thickness_mm: float) -> Scene:
    """Return the cell with the plate in the fixed gripper and the arm's jaws open about it.

    Parameters
    ----------
    layout : layout of the cell
    plate : at most, in the fixed gripper's frame
    thickness_mm : thickness of the plate, as wide as the fixed jaws are
    """
    T = np.asarray(layout.T_world_fixed_tcp, dtype=np.float64)
    return Scene(
        with_clearance(layout, UNMEASURED_MM),
        OPEN_MM,
        thickness_mm,
        standing=(Box(T @ plate.T, plate.half_mm),),
    )


def columns(layout: CellLayout, scene: Scene, end_mm: float) -> list[Column]:
    """Return the free approaches: at most one for each place across and flip.

    Parameters
    ----------
    layout : layout of the cell
    scene : scene with the plate in it
    end_mm : position of the plate's free end, in the fixed gripper's frame
    """
    found = []
    along_mm = stations_mm(layout, end_mm)
    for flip in (1, -1):
        for across_mm in ACROSS_MM:
            for turn_rad in TURNS_RAD:
                ready = JawsPlace(end_mm + AHEAD_MM, 0.0, across_mm, 0.0, turn_rad, flip)
                column = _column(layout, scene, ready, along_mm)
                if column is not None:
                    found.append(column)
                    break
    return found


def stations_mm(layout: CellLayout, end_mm: float) -> tuple[float, ...]:
    """Return how far from the fixed gripper's tips each face is touched, from the outside in.

    Parameters
    ----------
    layout : layout of the cell
    end_mm : position of the plate's free end, in the fixed gripper's frame
    """
    fronts = [
        box.T[0, 3] + float(np.abs(box.T[0, :3]) @ box.half_mm) for box in layout.arm_gripper.body
    ]
    inner_mm = max(INNER_MM, end_mm + PLATE_MM[0] + CLEAR_MM + max(fronts))
    return (OUTER_MM, (OUTER_MM + inner_mm) / 2.0, inner_mm)


def _column(
    layout: CellLayout, scene: Scene, ready: JawsPlace, along_mm: Sequence[float]
) -> Column | None:
    touches: list[tuple[JawsPlace, int]] = []
    for number, mm in enumerate(along_mm):
        # from one face to the other, and on along the face that was touched last
        for face in (1, -1) if number % 2 == 0 else (-1, 1):
            touches.append((ready.touching(mm, face), face))
    stops = [ready, *(place for place, _ in touches), ready]
    T_fixed = np.asarray(layout.T_world_fixed_tcp, dtype=np.float64)
    poses = [np.array([T_fixed @ one.pose() for one in _line(a, b)]) for a, b in pairwise(stops)]
    _, branches, _ = inverse_rows(layout, poses[0][:1])
    for branch in branches:
        lines = [same_branch(layout, T[None], np.array([branch]))[0] for T in poses]
        rows = np.concatenate(lines)
        if (
            np.isfinite(rows).all()
            and layout.arm.within_limits(rows).all()
            and scene.free(rows, MARGIN_MM).all()
        ):
            return Column(lines[0][0], tuple(lines), tuple(touches))
    return None


def _line(begin: JawsPlace, end: JawsPlace) -> list[JawsPlace]:
    way = np.array(
        [end.along_mm - begin.along_mm, end.off_mm - begin.off_mm, end.across_mm - begin.across_mm]
    )
    count = max(2, int(np.ceil(np.linalg.norm(way) / STEP_MM)) + 1)
    return [
        JawsPlace(
            begin.along_mm + share * way[0],
            begin.off_mm + share * way[1],
            begin.across_mm + share * way[2],
            begin.tilt_rad + share * (end.tilt_rad - begin.tilt_rad),
            begin.turn_rad,
            begin.flip,
        )
        for share in np.linspace(0.0, 1.0, count)
    ]


class Fingers:
    """The arm's open jaws about the plate.

    Parameters
    ----------
    bench : bench of the step
    scene : with the plate in the fixed gripper
    thickness_mm : thickness of the plate
    """

    def __init__(self, bench: Bench, scene: Scene, thickness_mm: float) -> None:
        self._bench = bench
        self._scene = scene
        self._thickness_mm = thickness_mm

    async def touch_along(self, column: Column, name: str) -> list[Touch]:
        """Go in along a column, touch, and go out again; return the touches.

        Raises
        ------
        StepFailedError : no free path leads there, or nothing is between the jaws
        DeviceError : a device does not answer or does not get there
        """
        bench = self._bench
        for waypoint in await bench.path_to(column.q_ready, self._scene, f"going to {name}"):
            await bench.motion.follow((waypoint,), first_speed=SLOW)
        found = []
        left = list(column.lines)
        for number, (place, face) in enumerate(column.touches, 1):
            await self._along(left.pop(0))
            try:
                one = await self._touch(f"{name}.{number}", place, face)
            except StepFailedError:
                for line in left:  # proven free, and the last leads out
                    await self._along(line)
                raise
            if one is not None:
                found.append(one)
        await self._along(left.pop())
        return found

    async def touch_again(self, column: Column, name: str) -> Touch | None:
        """Repeat the first touch of a column, and go out again along its line; return the touch.

        Raises
        ------
        StepFailedError : no free path leads there, or nothing is between the jaws
        DeviceError : a device does not answer or does not get there
        """
        bench = self._bench
        for waypoint in await bench.path_to(column.q_ready, self._scene, f"going to {name}"):
            await bench.motion.follow((waypoint,), first_speed=SLOW)
        await self._along(column.lines[0])
        place, face = column.touches[0]
        out = column.lines[0][::-1]
        try:
            found = await self._touch(name, place, face)
        except StepFailedError:
            await self._along(out)
            raise
        await self._along(out)
        return found

    async def _along(self, line: FloatArray) -> None:
        for q in fewest_waypoints(self._bench.layout, line)[1:]:
            await self._bench.motion.follow((q,), first_speed=SLOW)

    async def _touch(self, name: str, place: JawsPlace, face: int) -> Touch | None:
        bench = self._bench
        await bench.motion.ring_down()
        T_world_tcp = tcp_pose(bench.layout, (await bench.arm.read_q())[None])[0]
        opening_mm = OPEN_MM

        async def close() -> None:
            nonlocal opening_mm
            opening_mm = await bench.arm.grasp(TOUCH_FORCE, speed_share=TOUCH_SPEED)

        await bench.move_jaws(f"the arm gripper closes until it touches, {name}", close)
        await bench.move_jaws(
            say("the arm gripper opens to {open_mm:.0f} mm", open_mm=OPEN_MM),
            lambda: bench.arm.move_gripper_mm(OPEN_MM),
        )
        bench.evidence.show(f"{name}: touched at {opening_mm:.2f} mm")
        if opening_mm < self._thickness_mm - MET_MM:
            raise StepFailedError(
                say(
                    "{name}: the arm's jaws closed to {opening_mm:.1f} mm: the plate "
                    "is no longer in the fixed gripper, or has moved; take it out and "
                    "repeat the step",
                    name=name,
                    opening_mm=opening_mm,
                )
            )
        if opening_mm < self._thickness_mm + MET_MM:
            bench.evidence.find(f"{name} left out: both fingers met the plate")
            return None
        return Touch(name, T_world_tcp, opening_mm, face * place.flip, face)
