"""From a part lying on the table to the steps that show its surface and sort it.

Pairs of grips are ranked by what they can show between them and by seconds; the best ones are
worked out with all motions until one goes through. Same input, same plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from controller.cad import Solid, StablePose, SurfaceSamples

from ._prepare import prepare_part
from ._why import unseen_pieces
from .boxes import BoolArray, segments_hit
from .errors import NoMotionError, NoPlanError, OutOfReachError
from .grip import Grip
from .layout import CellLayout, FloatArray
from .motion import Scene, connect, fewest_waypoints, move_seconds
from .plan import (
    HandOver,
    Motion,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    Proof,
    Step,
    TakeBack,
    shown_pose,
)
from .prepared import HandOff, PlanOptions, PreparedPart
from .search import GripSequence, View, best_order, ranked_sequences
from .transfers import PickWay, PlaceWay, pick_ways, place_ways

BUILT_N = 8  # grip sequences whose motions are tried
SHADOW_LOSS = 0.005  # of the surface; configurations hiding more than the best one are dropped
MOTION_TRIES = 12


@dataclass(slots=True)
class _Build:
    """Steps so far, and where the arm stands."""

    q: FloatArray
    steps: list[Step] = field(default_factory=list)


def plan_part(
    solid: Solid,
    samples: SurfaceSamples,
    stable_pose: StablePose,
    T_world_part: FloatArray,
    layout: CellLayout,
    rng_seed: int = 0,
    options: PlanOptions | None = None,
    prepared: PreparedPart | None = None,
) -> Plan:
    """Return the steps that pick, show, pass over, show and place a part.

    Parameters
    ----------
    stable_pose : which way up it lies; T_world_part : (4, 4) where
    prepared : of `prepare_part` for the same solid, samples and layout; made here if None

    Raises
    ------
    NoPlanError : and its kinds, with one sentence: what, where, what to do
    """
    part = prepared or prepare_part(solid, samples, layout, options)
    picks = pick_ways(part, layout, T_world_part)
    pickable = sorted({way.grip for way in picks})
    ranked = ranked_sequences(part, layout, pickable)
    failure: NoPlanError | None = None
    built = 0
    no_tray: set[int] = set()  # last grips found unable to let the part go
    for sequence, views in ranked:
        if built == BUILT_N or sequence.grips[-1] in no_tray:
            continue
        built += 1
        ways = [w for w in picks if w.grip == sequence.first]
        for way in sorted(ways, key=lambda w: move_seconds(layout, [layout.park_q, w.down[0]]))[:2]:
            try:
                return _Planner(part, layout, T_world_part, rng_seed).build(
                    sequence, way, views, pickable, stable_pose
                )
            except OutOfReachError as error:
                failure = failure or error
                no_tray.add(sequence.grips[-1])
                break  # another way down changes nothing about the trays
            except NoPlanError as error:
                failure = failure or error
    raise failure or NoMotionError(
        f"{solid.name}: no view can be shown with any of the {len(pickable)} grips that can pick it"
    )


class _Planner:
    """Works one grip sequence out to the last waypoint."""

    def __init__(
        self, part: PreparedPart, layout: CellLayout, T_world_part: FloatArray, seed: int
    ) -> None:
        self._part = part
        self._layout = layout
        self._T_start = T_world_part
        self._seed = seed
        self._seen: BoolArray = np.zeros(len(part.samples.points_mm), dtype=bool)

    def build(
        self,
        sequence: GripSequence,
        way: PickWay,
        views: Sequence[View],
        pickable: Sequence[int],
        stable_pose: StablePose,
    ) -> Plan:
        """Return the whole plan.

        Raises
        ------
        NoPlanError : one of the motions cannot be done
        """
        part, layout = self._part, self._layout
        build = _Build(layout.park_q)
        self._pick(build, way)
        passing = part.hand_offs[sequence.fixture] if sequence.second >= 0 else {}
        leave = passing.get(sequence.first)
        self._show(build, sequence, 0, views, leave)
        if leave is not None:
            self._pass_over(build, sequence, leave, passing[sequence.second])
            self._show(build, sequence, 1, views, None)
        last = part.arm_grips[sequence.grips[-1]]
        place, park = self._sort(build, last)
        slowest = max(place[t].seconds + park[t].seconds for t in place)
        reach = set(pickable)
        for table in part.hand_offs:
            if reach & set(table):
                reach |= set(table)
        grips = [part.arm_grips[g] for g in sequence.grips]
        if leave is not None:
            grips.insert(1, part.fixture_grips[sequence.fixture])
        return Plan(
            steps=tuple(build.steps),
            place=place,
            park=park,
            forecast_s=sum(s.seconds for s in build.steps) + slowest,
            covered_fraction=float(part.weights[self._seen].sum()),
            reachable_fraction=float(part.weights[part.covered.any(axis=0)].sum()),
            unseen=unseen_pieces(part, layout, self._seen, sequence.grips, reach),
            grips=tuple(grips),
            proof=Proof(0.0, 0.0, "none"),
        )

    def _connect(self, build: _Build, q: FloatArray, scene: Scene, what: str) -> Motion:
        return connect(build.q, q, scene, f"{self._part.solid.name}: {what}", self._seed)

    def _seconds(self, start: FloatArray, *motions: Sequence[FloatArray]) -> float:
        return move_seconds(self._layout, [start, *(q for m in motions for q in m)])

    def _carrying(self, grip: Grip) -> Scene:
        return Scene(
            self._layout,
            grip.opening_mm,
            self._layout.fixture_open_mm,
            self._part.carried_box(grip),
        )

    def _pick(self, build: _Build, way: PickWay) -> None:
        part, layout = self._part, self._layout
        grip = part.arm_grips[way.grip]
        lying = part.part_box.placed(self._T_start)
        scene = Scene(layout, grip.pre_open_mm, layout.fixture_open_mm, standing=(lying,))
        motion_in = self._connect(build, way.down[0], scene, "way to the pick")
        down, up = tuple(way.down[1:]), tuple(way.up[1:])
        seconds = self._seconds(build.q, motion_in, down, up) + layout.pace.grip_s
        build.steps.append(
            Pick(
                seconds=seconds,
                label=f"pick with grip {grip.id}, {grip.opening_mm:.1f} mm",
                grip=grip,
                motion_in=motion_in,
                pre_open_mm=grip.pre_open_mm,
                motion_down=down,
                expected_opening_mm=grip.opening_mm,
                motion_up=up,
            )
        )
        build.q = way.up[-1]

    def _show(
        self,
        build: _Build,
        sequence: GripSequence,
        phase: int,
        views: Sequence[View],
        leave: HandOff | None,
    ) -> None:
        """Add the views of one holding phase; views without a way are dropped, not the plan."""
        part, layout = self._part, self._layout
        g = sequence.grips[phase]
        grip = part.arm_grips[g]
        scene = self._carrying(grip)
        todo = {v: self._clear_configurations(grip, g, v, scene) for p, v in views if p == phase}
        speed = np.array(layout.pace.joint_per_s)
        end = None if leave is None else leave.entry[0]
        tries = 0
        while todo:
            names = list(todo)
            order = best_order(build.q, [todo[v] for v in names], end, speed)
            i, k = order[0]
            v = names[i]
            q = todo[v][k]
            try:
                motion = self._connect(build, q, scene, f"way to view {v}")
            except NoMotionError:
                tries += 1
                todo[v] = np.delete(todo[v], k, axis=0)
                if len(todo[v]) == 0 or tries > MOTION_TRIES:
                    del todo[v]
                continue
            del todo[v]
            self._present(build, grip, g, v, q, motion, scene)

    def _clear_configurations(self, grip: Grip, g: int, v: int, scene: Scene) -> FloatArray:
        """Return the configurations of a view in which the arm's links hide the least."""
        rows = self._part.view_q[g][v]
        shares = np.array(
            [self._part.weights[self._in_sight(grip, g, v, q, scene)].sum() for q in rows]
        )
        kept: FloatArray = rows[shares >= shares.max() - SHADOW_LOSS]
        return kept

    def _in_sight(self, grip: Grip, g: int, v: int, q: FloatArray, scene: Scene) -> BoolArray:
        part, layout = self._part, self._layout
        seen: BoolArray = part.shown_by(g)[v].copy()
        T = shown_pose(layout, q, grip.T_part_hand)
        points = part.samples.points_mm[seen] @ T[:3, :3].T + T[:3, 3]
        hidden = segments_hit(points, layout.inspection.position_mm, scene.arm_boxes(q))
        seen[np.flatnonzero(seen)[hidden]] = False
        return seen

    def _present(
        self,
        build: _Build,
        grip: Grip,
        g: int,
        v: int,
        q: FloatArray,
        motion: Motion,
        scene: Scene,
    ) -> None:
        part, layout = self._part, self._layout
        seen = self._in_sight(grip, g, v, q, scene)
        self._seen |= seen
        face_id = int(part.directions.square_to[v])
        label = f"show with grip {grip.id}"
        if face_id >= 0:
            label += f", square to {part.solid.faces[face_id].label}"
        build.steps.append(
            Present(
                seconds=self._seconds(build.q, motion) + layout.pace.look_s,
                label=label,
                view_id=f"{grip.id}-V{v}",
                grip=grip,
                motion=motion,
                q=q,
                T_world_part=shown_pose(layout, q, grip.T_part_hand),
                direction_part=part.directions.vectors[v],
                seen=seen,
                square_to=face_id,
                expected_opening_mm=grip.opening_mm,
            )
        )
        build.q = q

    def _pass_over(
        self, build: _Build, sequence: GripSequence, leave: HandOff, take: HandOff
    ) -> None:
        part, layout = self._part, self._layout
        first, second = part.arm_grips[sequence.first], part.arm_grips[sequence.second]
        held = part.fixture_grips[sequence.fixture]
        pace = layout.pace
        scene = Scene(layout, first.opening_mm, held.pre_open_mm, part.carried_box(first))
        motion = (
            *self._connect(build, leave.entry[0], scene, "way to the fixture"),
            *fewest_waypoints(layout, leave.entry)[1:],
        )
        retreat = tuple(fewest_waypoints(layout, leave.retreat)[1:])
        build.steps.append(
            HandOver(
                seconds=self._seconds(build.q, motion, retreat) + pace.grip_s + pace.release_s,
                label=f"hand over to the fixture, grip {held.id}",
                grip=first,
                fixture_grip=held,
                fixture_pre_open_mm=held.pre_open_mm,
                motion=motion,
                fixture_expected_opening_mm=held.opening_mm,
                hand_open_mm=first.pre_open_mm,
                retreat=retreat,
            )
        )
        build.q = leave.retreat[-1]
        T_part = shown_pose(layout, leave.q, first.T_part_hand)
        standing = part.part_box.placed(T_part)
        # the jaws stay as they let go until the straight way in begins: wide ones may pass on both
        # sides of a part that narrower ones run into
        scene = Scene(layout, first.pre_open_mm, held.opening_mm, standing=(standing,))
        way = tuple(fewest_waypoints(layout, take.retreat[::-1]))
        motion_in = self._connect(build, way[0], scene, "way round the fixture")
        motion_out = tuple(fewest_waypoints(layout, take.entry[::-1])[1:])
        build.steps.append(
            TakeBack(
                seconds=self._seconds(build.q, motion_in, way[1:], motion_out)
                + pace.grip_s
                + pace.release_s,
                label=f"take back with grip {second.id}, {second.opening_mm:.1f} mm",
                grip=second,
                fixture_grip=held,
                motion_in=motion_in,
                pre_open_mm=second.pre_open_mm,
                approach=tuple(way[1:]),
                expected_opening_mm=second.opening_mm,
                fixture_open_mm=held.pre_open_mm,
                motion_out=motion_out,
            )
        )
        build.q = take.entry[0]

    def _sort(self, build: _Build, grip: Grip) -> tuple[dict[str, Place], dict[str, Park]]:
        part, layout = self._part, self._layout
        place: dict[str, Place] = {}
        park: dict[str, Park] = {}
        for name, tray in layout.trays.items():
            failure: NoPlanError = OutOfReachError(
                f"{part.solid.name}: grip {grip.id} cannot let it go anywhere over tray {name} at "
                f"({tray.centre_mm[0]:.0f}, {tray.centre_mm[1]:.0f}); move the tray nearer",
                reach_mm=float(np.hypot(*tray.centre_mm)),
                limit_mm=layout.arm.upper_mm + layout.arm.fore_mm,
                where=f"tray {name}",
            )
            ways = place_ways(part, layout, grip, tray)
            # every place is tried with the plain ways before any is searched for
            for way, search in [(w, False) for w in ways] + [(w, True) for w in ways[:2]]:
                try:
                    place[name], park[name] = self._let_go(build.q, grip, name, way, search)
                except NoMotionError as error:
                    failure = error
                    continue
                break
            else:
                raise failure
        return place, park

    def _let_go(
        self, start: FloatArray, grip: Grip, tray: str, way: PlaceWay, search: bool
    ) -> tuple[Place, Park]:
        layout, name = self._layout, self._part.solid.name
        motion = connect(
            start,
            way.down[0],
            self._carrying(grip),
            f"{name}: way to tray {tray}",
            self._seed,
            search,
        )
        empty = Scene(layout, grip.pre_open_mm, layout.fixture_open_mm)
        home = connect(way.up[-1], layout.park_q, empty, f"{name}: way home", self._seed, search)
        down, up = tuple(way.down[1:]), tuple(way.up[1:])
        place = Place(
            seconds=self._seconds(start, motion, down, up) + layout.pace.release_s,
            label=f"place in tray {tray}",
            tray=tray,
            grip=grip,
            motion=motion,
            motion_down=down,
            open_mm=grip.pre_open_mm,
            motion_up=up,
            T_world_part=way.T_world_part,
            tilt_rad=way.tilt_rad,
        )
        return place, Park(seconds=self._seconds(way.up[-1], home), label="park", motion=home)
