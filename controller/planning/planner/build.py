"""Full construction of a sequence of grasps and views, down to the last waypoint.

The element without a path is named, so that the search can continue without it and without anything
else (planning-facts.md 1.3, lazy verification).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from controller.arrays import BoolArray, FloatArray
from messages import key, say

from ..geometry import PlacedShape
from ..model import (
    CellLayout,
    GiveStep,
    Grasp,
    HandOff,
    JointPath,
    NoMotionError,
    NoPlanError,
    OutOfReachError,
    Park,
    Pick,
    Place,
    PreparedPart,
    Present,
    ReceiveStep,
    SetDown,
    Step,
    Tray,
    lit_count,
)
from ..motion import Scene, connect, fewest_waypoints, move_seconds, segment_seconds, shown_pose
from ..regrasps import PickPath, PlacePath, place_paths
from ..search import EXACT_STOPS, best_order
from .confirming import shows_outline

MOTION_TRIES = 12


class RefutedError(Exception):
    """A part of the sequence has no path; `what` is a refutation for `search.refuted`.

    Parameters
    ----------
    reason : reason why it cannot be driven
    regrasps : (from, to) grasps between which no motion was found
    views : (grasp, view) views that cannot be taken
    firsts, lasts : grasps that cannot be had at the start, or be finished from
    """

    def __init__(
        self,
        reason: NoPlanError,
        *,
        regrasps: Sequence[tuple[int, int]] = (),
        views: Sequence[tuple[int, int]] = (),
        firsts: Sequence[int] = (),
        lasts: Sequence[int] = (),
    ) -> None:
        super().__init__(str(reason))
        self.reason = reason
        self.regrasps, self.views, self.firsts, self.lasts = regrasps, views, firsts, lasts


@dataclass(slots=True)
class Build:
    """The steps so far, the arm's configuration, and the surface shown."""

    q: FloatArray
    seen: BoolArray
    steps: list[Step] = field(default_factory=list)


class Builder:
    """Adds steps of one part to a build.

    Parameters
    ----------
    part : prepared
    layout : the cell
    seed : seed of the random trees
    """

    def __init__(self, part: PreparedPart, layout: CellLayout, seed: int) -> None:
        self._part = part
        self._layout = layout
        self._seed = seed
        self._segment_s = partial(segment_seconds, layout)
        self._tray_paths: dict[tuple[int, str], list[PlacePath]] = {}

    def _connect(self, build: Build, q: FloatArray, scene: Scene, what: str) -> JointPath:
        return connect(
            build.q,
            q,
            scene,
            say("{name}: {what}", name=self._part.solid.name, what=what),
            self._seed,
        )

    def _seconds(self, start: FloatArray, *motions: Sequence[FloatArray]) -> float:
        return move_seconds(self._layout, [start, *(q for m in motions for q in m)])

    def _carrying(self, grasp: Grasp) -> Scene:
        return Scene(
            self._layout,
            grasp.opening_mm,
            self._layout.fixed_open_mm,
            carried_mesh=self._part.carried(grasp),
        )

    # ---- picking ------------------------------------------------------------------------------
    def pick(self, build: Build, paths: Sequence[PickPath], T_world_part: FloatArray) -> None:
        """Add the step that takes the part off the table, by the first path that can be driven.

        Parameters
        ----------
        build : steps so far; the pick is added, and the arm then stands where it ends
        paths : paths of one grasp, the preferred one first; at least one
        T_world_part : (4, 4) pose of the part on the table

        Raises
        ------
        RefutedError : none of them can
        """
        part, layout = self._part, self._layout
        grasp = part.arm_grasps[paths[0].grasp]
        resting = PlacedShape(part.shape, T_world_part)
        scene = Scene(layout, grasp.pre_open_mm, layout.fixed_open_mm, standing_meshes=(resting,))
        failure: NoPlanError | None = None
        for path in paths:
            try:
                motion_in = self._connect(build, path.down[0], scene, key("path to the pick"))
            except NoMotionError as error:
                failure = failure or error
                continue
            down, up = tuple(path.down[1:]), tuple(path.up[1:])
            build.steps.append(
                Pick(
                    seconds=self._seconds(build.q, motion_in, down, up) + layout.cell_times.pick_s,
                    label=say(
                        "pick with grasp {id}, {opening_mm:.1f} mm",
                        id=grasp.id,
                        opening_mm=grasp.opening_mm,
                    ),
                    grasp=grasp,
                    motion_in=motion_in,
                    pre_open_mm=grasp.pre_open_mm,
                    motion_down=down,
                    expected_opening_mm=grasp.opening_mm,
                    motion_up=up,
                )
            )
            build.q = path.up[-1]
            return
        assert failure is not None
        raise RefutedError(failure, firsts=[paths[0].grasp])

    def receive(
        self, build: Build, g: int, take: HandOff, held: Grasp, T_world_part: FloatArray
    ) -> None:
        """Add the step that takes the part from the fixed gripper.

        Parameters
        ----------
        build : steps so far; this one is added
        g : number of the arm's grasp
        take : the hand-off as it would be driven to give the part; it is driven backwards
        held : grasp of the fixed gripper
        T_world_part : (4, 4) pose of the part while the fixed gripper holds it

        Raises
        ------
        NoMotionError : there is no path round it
        """
        part, layout = self._part, self._layout
        grasp = part.arm_grasps[g]
        standing = PlacedShape(part.shape, T_world_part)
        opening = _standing_opening(build, layout)
        # the jaws stay as they let go until the straight path in begins: wide ones may pass on both
        # sides of a part that narrower ones run into
        scene = Scene(layout, opening, held.opening_mm, standing_meshes=(standing,))
        path = tuple(fewest_waypoints(layout, take.retreat[::-1]))
        motion_in = self._connect(build, path[0], scene, key("path round the fixed gripper"))
        motion_out = tuple(fewest_waypoints(layout, take.entry[::-1])[1:])
        build.steps.append(
            ReceiveStep(
                seconds=self._seconds(build.q, motion_in, path[1:])
                + self._seconds(path[-1], motion_out)
                + layout.cell_times.receive_s,
                label=say(
                    "receive back with grasp {id}, {opening_mm:.1f} mm",
                    id=grasp.id,
                    opening_mm=grasp.opening_mm,
                ),
                grasp=grasp,
                fixed_grasp=held,
                motion_in=motion_in,
                pre_open_mm=grasp.pre_open_mm,
                approach=tuple(path[1:]),
                expected_opening_mm=grasp.opening_mm,
                fixed_open_mm=held.pre_open_mm,
                motion_out=motion_out,
            )
        )
        build.q = take.entry[0]

    # ---- regrasping ---------------------------------------------------------------------------
    def give(self, build: Build, g: int, leave: HandOff, held: Grasp) -> FloatArray:
        """Add the step that gives the part to the fixed gripper; return T_world_part (4, 4) there.

        Parameters
        ----------
        build : steps so far; this one is added
        g : number of the arm's grasp
        leave : motion of the hand-off
        held : grasp of the fixed gripper

        Raises
        ------
        NoMotionError : there is no path to it
        """
        part, layout = self._part, self._layout
        grasp = part.arm_grasps[g]
        scene = Scene(layout, grasp.opening_mm, held.pre_open_mm, carried_mesh=part.carried(grasp))
        motion = (
            *self._connect(build, leave.entry[0], scene, key("path to the fixed gripper")),
            *fewest_waypoints(layout, leave.entry)[1:],
        )
        retreat = tuple(fewest_waypoints(layout, leave.retreat)[1:])
        build.steps.append(
            GiveStep(
                seconds=self._seconds(build.q, motion, retreat) + layout.cell_times.give_step_s,
                label=say("hand off to the fixed gripper, grasp {id}", id=held.id),
                grasp=grasp,
                fixed_grasp=held,
                fixed_pre_open_mm=held.pre_open_mm,
                motion=motion,
                fixed_expected_opening_mm=held.opening_mm,
                arm_open_mm=grasp.pre_open_mm,
                retreat=retreat,
            )
        )
        build.q = leave.retreat[-1]
        return shown_pose(layout, leave.q, grasp.T_part_tcp)

    def set_down(
        self, build: Build, g: int, leave: HandOff, T_world_part: FloatArray, pose_index: int
    ) -> None:
        """Add the step that sets the part down on the table.

        Parameters
        ----------
        build : steps so far; this one is added
        g : number of the arm's grasp
        leave : motion of setting the part down
        T_world_part : (4, 4) pose of the part on the table afterwards
        pose_index : number of the stable pose it then has

        Raises
        ------
        NoMotionError : there is no path to it
        """
        part, layout = self._part, self._layout
        grasp = part.arm_grasps[g]
        motion = self._connect(
            build, leave.entry[0], self._carrying(grasp), key("path to the table")
        )
        down = tuple(fewest_waypoints(layout, leave.entry)[1:])
        up = tuple(fewest_waypoints(layout, leave.retreat)[1:])
        cell_times = layout.cell_times
        build.steps.append(
            SetDown(
                seconds=self._seconds(build.q, motion, down, up)
                + cell_times.put_s
                + cell_times.relook_s,
                label=say("set down in pose {pose_index}", pose_index=pose_index),
                grasp=grasp,
                motion=motion,
                motion_down=down,
                open_mm=grasp.pre_open_mm,
                motion_up=up,
                T_world_part=T_world_part,
                pose_index=pose_index,
            )
        )
        build.q = leave.retreat[-1]

    # ---- showing -------------------------------------------------------------------------------
    def show(self, build: Build, g: int, views: Sequence[int], end: FloatArray | None) -> None:
        """Add the views (directions) of one grasp, in the quickest order.

        The first one of a new grasp verifies it: one of those that show the part's outline, or
        another view that does.

        Parameters
        ----------
        build : steps so far; the views are added
        g : number of the arm's grasp
        views : numbers of directions
        end : (6,) final joints of the arm; None for anywhere

        Raises
        ------
        RefutedError : a view cannot be driven to
        """
        part = self._part
        grasp = part.arm_grasps[g]
        scene = self._carrying(grasp)
        todo = {v: part.view_q[g][v] for v in views}
        tries = 0
        order: list[tuple[int, int]] = []
        is_new = bool(todo) and bool(build.steps) and not isinstance(build.steps[-1], Present)
        while todo:
            # the fewer of many views are left, the better is their order found; a dozen's exactly
            if not order or len(todo) % EXACT_STOPS == 0:
                names = list(todo)
                found = best_order(build.q, [todo[v] for v in names], end, self._segment_s)
                order = [(names[i], k) for i, k in found]
            v, k = order.pop(0)
            if is_new:
                order, (v, k) = [], self._confirming(build, g, (v, k), todo)
                todo.setdefault(v, part.view_q[g][v])
                is_new = False
            q = todo[v][k]
            try:
                motion = self._connect(build, q, scene, say("path to view {v}", v=v))
            except NoMotionError as error:
                tries += 1
                todo[v], order = np.delete(todo[v], k, axis=0), []
                if len(todo[v]) == 0 or tries > MOTION_TRIES:
                    raise RefutedError(error, views=[(g, v)]) from error
                continue
            del todo[v]
            # a new grasp's first view is judged before the second, its last before what follows
            waits = not todo or not build.steps or not isinstance(build.steps[-1], Present)
            self._present(build, g, v, q, motion, waits=waits)

    def _confirming(
        self, build: Build, g: int, first: tuple[int, int], todo: Mapping[int, FloatArray]
    ) -> tuple[int, int]:
        """Return the view and configuration by which a new grasp is verified.

        Parameters
        ----------
        build : steps so far
        g : number of the arm's grasp
        first : view and configuration that would be the quickest
        todo : configurations of the views to be shown
        """
        grasp, scene = self._part.arm_grasps[g], self._carrying(self._part.arm_grasps[g])

        def is_seen(q: FloatArray) -> bool:
            T = shown_pose(self._layout, q, grasp.T_part_tcp)
            return shows_outline(self._layout, scene, q, self._part.solid.hull_mm, T)

        if is_seen(todo[first[0]][first[1]]):
            return first
        for views in (todo, self._part.view_q[g]):
            every = [(v, k, q) for v, rows in views.items() for k, q in enumerate(rows)]
            every.sort(key=lambda one: float(self._segment_s(build.q, one[2])))
            found = next(((v, k) for v, k, q in every if is_seen(q)), None)
            if found is not None:
                return found
        return first

    def _present(
        self, build: Build, g: int, v: int, q: FloatArray, motion: JointPath, *, waits: bool
    ) -> None:
        part, layout = self._part, self._layout
        grasp = part.arm_grasps[g]
        # true of every configuration kept: what the arm hides in them has been taken off
        seen = part.shown[g][v]
        build.seen |= seen
        face_id = int(part.directions.square_to[v])
        label = say("show with grasp {id}", id=grasp.id)
        if face_id >= 0:
            label += say(", square to {label}", label=part.solid.faces[face_id].label)
        times = layout.cell_times
        wait_s = times.judge_s if waits else 0.0
        look_s = times.look_s(lit_count(is_square=face_id >= 0))
        build.steps.append(
            Present(
                seconds=self._seconds(build.q, motion) + look_s + wait_s,
                wait_s=wait_s,
                label=label,
                view_id=f"{grasp.id}-V{v}",
                grasp=grasp,
                motion=motion,
                q=q,
                T_world_part=shown_pose(layout, q, grasp.T_part_tcp),
                direction_part=part.directions.vectors[v],
                seen=seen,
                square_to=face_id,
                expected_opening_mm=grasp.opening_mm,
            )
        )
        build.q = q

    # ---- placing ------------------------------------------------------------------------------
    def check_trays(self, g: int) -> None:
        """Check that a grasp can release the part over every tray, before anything is worked out.

        Raises
        ------
        RefutedError : it cannot
        """
        part = self._part
        for name, tray in self._layout.trays.items():
            if (g, name) not in self._tray_paths:
                paths = place_paths(part, self._layout, part.arm_grasps[g], tray)
                self._tray_paths[g, name] = paths
            if not self._tray_paths[g, name]:
                raise RefutedError(self._tray_missed(g, name), lasts=[g])

    def _tray_missed(self, g: int, name: str) -> OutOfReachError:
        arm, tray = self._layout.arm, self._layout.trays[name]
        away, limit = tray_distance_mm(self._layout, tray), arm.reach_mm
        if tray.nest is not None:
            x, y = tray.nest.size_mm
            return OutOfReachError(
                say(
                    "{name}: grasp {id} cannot set it down flat in nest {nest} of "
                    "tray {tray}, which has room for {x:.0f} x {y:.0f} mm, clear of "
                    "what stands in the tray; make its nests larger or fewer",
                    name=self._part.solid.name,
                    id=self._part.arm_grasps[g].id,
                    nest=tray.next_nest + 1,
                    tray=name,
                    x=x,
                    y=y,
                ),
                reach_mm=away,
                limit_mm=limit,
                where=f"tray {name}",
            )
        return OutOfReachError(
            say(
                "{name}: grasp {id} cannot release it anywhere over tray {tray}, "
                "{away:.0f} mm from the arm's axis (the wrist reaches {limit:.0f} "
                "mm, the gripper {tool_mm:.0f} mm more); move the tray",
                name=self._part.solid.name,
                id=self._part.arm_grasps[g].id,
                tray=name,
                away=away,
                limit=limit,
                tool_mm=arm.tool_mm,
            ),
            reach_mm=away,
            limit_mm=limit,
            where=f"tray {name}",
        )

    def sort(self, build: Build, g: int) -> tuple[dict[str, Place], dict[str, Park]]:
        """Return the part's path into each tray, and the arm's path home from there.

        Raises
        ------
        RefutedError : a tray cannot be served with this grasp
        """
        self.check_trays(g)
        grasp = self._part.arm_grasps[g]
        place: dict[str, Place] = {}
        park: dict[str, Park] = {}
        for name in self._layout.trays:
            failure: NoPlanError | None = None
            paths = self._tray_paths[g, name]
            # every place is tried with the joint line and detours before random trees are
            for path, search in [(w, False) for w in paths] + [(w, True) for w in paths[:2]]:
                try:
                    place[name], park[name] = self._let_go(build.q, grasp, name, path, search)
                except NoMotionError as error:
                    failure = failure or error
                    continue
                break
            else:
                assert failure is not None
                raise RefutedError(failure, lasts=[g])
        return place, park

    def _let_go(
        self, start: FloatArray, grasp: Grasp, tray: str, path: PlacePath, search: bool
    ) -> tuple[Place, Park]:
        layout, name = self._layout, self._part.solid.name
        motion = connect(
            start,
            path.down[0],
            self._carrying(grasp),
            say("{name}: path to tray {tray}", name=name, tray=tray),
            self._seed,
            search,
        )
        empty = Scene(layout, grasp.pre_open_mm, layout.fixed_open_mm)
        home = connect(
            path.up[-1],
            layout.park_q,
            empty,
            say("{name}: path home", name=name),
            self._seed,
            search,
        )
        down, up = tuple(path.down[1:]), tuple(path.up[1:])
        times = layout.cell_times
        place = Place(
            seconds=self._seconds(start, motion, down, up) + times.put_s + times.verdict_s,
            wait_s=times.verdict_s,
            label=say("place in tray {tray}", tray=tray),
            tray=tray,
            grasp=grasp,
            motion=motion,
            motion_down=down,
            open_mm=grasp.pre_open_mm,
            motion_up=up,
            T_world_part=path.T_world_part,
            tilt_rad=path.tilt_rad,
        )
        return place, Park(seconds=self._seconds(path.up[-1], home), label="park", motion=home)


def tray_distance_mm(layout: CellLayout, tray: Tray) -> float:
    """Return the distance of a tray's middle from the arm's axis [mm]."""
    T_arm = layout.T_world_arm
    return float(np.hypot(*(np.array(tray.centre_mm) - T_arm[:2, 3])))


def check_trays_in_reach(name: str, layout: CellLayout) -> None:
    """Check that the arm gripper reaches every tray, with any load.

    Raises
    ------
    OutOfReachError : a tray is farther away than the outstretched arm
    """
    arm = layout.arm
    limit = arm.reach_mm + arm.tool_mm
    for tray_name, tray in layout.trays.items():
        away = tray_distance_mm(layout, tray)
        if away > limit + max(tray.size_mm) / 2:
            raise OutOfReachError(
                say(
                    "{name}: tray {tray_name} is {away:.0f} mm from the arm's axis, "
                    "the outstretched arm with its gripper reaches {limit:.0f} mm; "
                    "move the tray nearer",
                    name=name,
                    tray_name=tray_name,
                    away=away,
                    limit=limit,
                ),
                reach_mm=away,
                limit_mm=arm.reach_mm,
                where=f"tray {tray_name}",
            )


def _standing_opening(build: Build, layout: CellLayout) -> float:
    """Return the opening of the empty gripper: as it last let go, else the widest [mm]."""
    last = build.steps[-1] if build.steps else None
    return last.arm_open_mm if isinstance(last, GiveStep) else layout.arm_gripper.max_mm
