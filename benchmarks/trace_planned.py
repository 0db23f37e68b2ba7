"""Series of parts in planned views, path-traced: good pieces and pieces with one defect each.

    python benchmarks/trace_planned.py FOLDER=PART:SEED... [--good 2] [--defects 4] [--until 21:40]
    python benchmarks/bench_planned.py FOLDER...

PART is FAMILY_NUMBER, as `fork_2002`: a part of `trace_held_parts.py`. Its views are those that
`cellctl plan` finds in the emulated cell with the six-line recipe that is written beside: look on
the table, poses, lamps, boxes of arm and gripper. The pieces are those of `trace_series.py`: each
built anew within its tolerances, with a finish and dust of its own. They lie in the fingers, and
the arm errs from view to view, as a run has it: the expected poses are those by the hold that the
first view of a grasp measured.

Each FOLDER has s0001/SET.json up, in the form of a run's own archive, with pictures; truth.json;
parts/PART.stl and PART.yaml, the recipe. What is far from the part is traced by few rays. One core,
some eight minutes a piece of twenty-five views.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from trace_held import HAND_LOOK, MIN_SHOWN_PX, Array, Body, Words, draw_look, rounded
from trace_held_hold import Box, Grasp, View, disturbed
from trace_held_light import LAMPS, Seen, Sight, Thing, changed_px, trace_view
from trace_held_parts import NOMINAL_SAG_MM, HeldPart, drawn, write_stl
from trace_held_sensor import develop, draw_sensor, exposures
from trace_series import Piece, Series, trace

from controller.cell.devices.lamps import STATION_PANEL, TABLE_PANEL
from controller.cell.services.views.part_file import box_section, camera_section, pose_rows
from controller.config import EMULATED_CELL, Cell, load_cell, load_recipe
from controller.config.cell import CameraSection, LampSection
from controller.config.view_set import SCHEMA, SetView, ViewSetFile, packed
from controller.imaging import inverse_pose
from controller.inspection import MEASURED_HOLD, WorldBox
from controller.interface import plan_part
from controller.planning import Look, Plan, Present
from controller.setup.holder import holder_boxes
from controller.setup.layout import build_layout
from controller.setup.optics import build_camera, light_of, table_light

RECIPE = """\
name: {name}
part: parts/{name}.stl
unit: mm
density_g_cm3: 2.7
inspection: {{required: stated}}
"""
IN_PLANE_MM, IN_PLANE_DEG = 0.6, 0.8  # slip along the pads, at most
ACROSS_MM, ACROSS_DEG = 0.03, 0.15  # across them, which they prevent
ARM_MM, ARM_DEG = 0.12, 0.12  # by which a view is off its commanded pose, at most
MEASURED_MM, MEASURED_DEG = 0.05, 0.05  # by which a hold is measured wrong, at most
SIGHTED_MM, SIGHTED_DEG = 0.2, 0.15  # by which a part is recognised wrong, at most
NEAR_PX = 40  # as far from the part all is traced in full
UNEVEN, PANEL_ALBEDO = 0.05, 0.08


@dataclass(frozen=True, eq=False)
class Stage:
    """A camera with its panel and lamps, in a frame of its own: panel in z = 0, camera above.

    Attributes
    ----------
    T_world : pose of that frame in the cell's world
    station : lamps and panel, as `trace_view` has them
    names : the cell's names of the lamps by the tracer's
    """

    sight: Sight
    T_world: Array
    station: Words
    names: dict[str, str]


@dataclass(frozen=True, eq=False)
class PlannedView(View):
    """A view of a plan: of the grasp with this number, the part in the frame of its stage."""

    name: str
    stage: Stage
    boxes: tuple[Box, ...]
    in_sight: Array


def stages(cell: Cell, tilt: float) -> tuple[Stage, Stage]:
    """Return the inspection station and the table of a cell."""
    panel, lamps = cell.lamps[STATION_PANEL], cell.lamps
    up, normal = np.array(panel.up, float), np.array(panel.normal, float)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([np.cross(up, normal), up, normal])
    T[:3, 3] = panel.centre
    part = _within(T, cell.station.position)
    ring, side = lamps["station_ring"], lamps["station_side"]
    station = _station(panel.size, ring, T, part[2], tilt) | {
        "side": {"centre": _within(T, side.centre).tolist(), "half_mm": [side.diameter / 2] * 2}
    }
    names = dict(zip(LAMPS, (STATION_PANEL, "station_ring", "station_side"), strict=True))
    held = Stage(_sight(cell.cameras.inspection, T), T, station, names)
    light = table_light(cell)
    T = np.eye(4)
    T[:3, 3] = light.centre
    table = _station(light.size, lamps["table_ring"], T, 15.0, tilt)
    names = {"backlight": TABLE_PANEL, "ring": "table_ring"}
    return held, Stage(_sight(cell.cameras.overhead, T), T, table, names)


def _station(
    size: Sequence[float], ring: LampSection, T: Array, held_mm: float, tilt: float
) -> Words:
    return {
        "panel_mm": list(size),
        "panel_albedo": PANEL_ALBEDO,
        "uneven": UNEVEN,
        "tilt": tilt,
        "held_mm": float(held_mm),
        "ring": {
            "inner_mm": ring.radius - ring.width / 2,
            "outer_mm": ring.radius + ring.width / 2,
            "centre": _within(T, ring.centre).tolist(),
        },
    }


def _within(T: Array, p: Sequence[float]) -> Array:
    """Return a point of the world in a frame."""
    return np.asarray(T[:3, :3].T @ (np.asarray(p, float) - T[:3, 3]))


def _sight(section: CameraSection, T: Array) -> Sight:
    camera = build_camera(section)
    return Sight(camera.size_px, camera.K, camera.distortion, inverse_pose(T) @ camera.T_world_cam)


class PlannedPart:
    """A part, its plan, and the station that shows it: what its pieces share."""

    def __init__(self, folder: Path, part: HeldPart, seed: int) -> None:
        self.seed, self.part = seed, part
        rng = np.random.default_rng([seed, 9])
        self.cell = load_cell(EMULATED_CELL)
        self.recipe_path = folder / f"{part.name}.yaml"
        cad = folder / "parts" / f"{part.name}.stl"
        cad.parent.mkdir(parents=True, exist_ok=True)
        if not cad.exists():
            write_stl(part.build(sag_mm=NOMINAL_SAG_MM), cad)
            self.recipe_path.write_text(RECIPE.format(name=part.name))
        self.layout = build_layout(self.cell)
        self.plan = plan_part(cad, recipe=self.recipe_path)
        held, table = stages(self.cell, float(rng.uniform(-0.05, 0.05)))
        self.sight, self.station, self.sensor = held.sight, held.station, draw_sensor(rng)
        self.hidden: list[int] = []
        self.grasps, self.views = self._views(self.plan, held, table)
        self.coverage = self.plan.covered_fraction
        self.look, self.material = draw_look(np.random.default_rng([seed, 8]), plain=False)

    def _views(
        self, plan: Plan, held: Stage, table: Stage
    ) -> tuple[list[Grasp], list[PlannedView]]:
        """Return the grasps, the table first, and the views in the plan's order."""
        found: list[PlannedView] = []
        grasps: list[Grasp] = []
        numbers: dict[str, int] = {}
        for step in plan.steps:
            if isinstance(step, Look):
                key, stage, placed = "table", table, ()
                T_tcp, width = np.eye(4), 0.0
            elif isinstance(step, Present):
                key, stage, T_tcp = str(step.grasp.id), held, step.grasp.T_part_tcp
                width = step.grasp.opening_mm
                placed = holder_boxes(self.layout, step.q, width)
            else:
                continue
            if key not in numbers:
                numbers[key] = len(grasps)
                grasps.append(Grasp((), T_tcp[:3, 1], T_tcp[:3, 0], width, 0.0))
            T_stage = inverse_pose(stage.T_world)
            boxes = tuple(Box(T_stage @ box.T, box.half_mm) for box in placed)
            T = T_stage @ step.T_world_part
            found.append(PlannedView(numbers[key], T, step.view_id, stage, boxes, step.seen))
        return grasps, found


class PlannedPiece(Piece):
    """One piece of a part, shown by its plan."""

    def erred(self, view: View, pivot: Array, rng: np.random.Generator) -> Array:
        """Return by how much the arm is off in a view; what lies on the table is where it is."""
        if not view.boxes:
            return np.eye(4)
        return disturbed(np.eye(4), pivot, ARM_MM, ARM_DEG, rng)

    def slipped(self, middle: Array, rng: np.random.Generator) -> list[Array]:
        """Return how the part lies in the fingers: moved along the pads, hardly across."""
        out = [np.eye(4)]
        for grasp in self.grasps[1:]:
            R = np.column_stack(
                [grasp.approach, grasp.closing, np.cross(grasp.approach, grasp.closing)]
            )
            reach = [IN_PLANE_MM, ACROSS_MM, IN_PLANE_MM]
            turn = [ACROSS_DEG, IN_PLANE_DEG, ACROSS_DEG]
            shift = R @ (rng.uniform(-1, 1, 3) * reach)
            rotation, _ = cv2.Rodrigues(R @ (np.radians(turn) * rng.uniform(-1, 1, 3)))
            T = np.eye(4)
            T[:3, :3] = rotation
            T[:3, 3] = middle - rotation @ middle + shift
            out.append(T)
        return out

    def things(self, view: View, body: Body | None = None) -> list[Thing]:
        """Return what stands before the camera: the part in the fingers, the arm that errs."""
        number = next(i for i, one in enumerate(self.views) if one is view)
        part, *rest = super().things(view, body)
        of_arm = [
            Thing(box.triangles_mm(), self.errors[number] @ box.T, HAND_LOOK, is_smooth=False)
            for box in view.boxes
        ]
        return [part, *of_arm, *rest]

    def trace(self) -> tuple[list[dict[str, Any]], list[Words]]:
        """Return pictures view by view, and what each view shows."""
        seen: list[Seen] = []
        shows: list[Words] = []
        for number, view in enumerate(self.views):
            things, stage = self.things(view), view.stage
            seed = (self.seed * 1000 + self.number) * 100 + number
            lamps = tuple(stage.names)
            seen.append(
                trace_view(stage.sight, things, stage.station, lamps, seed, near_px=NEAR_PX)
            )
            words: Words = {"view": view.name, "grasp": view.grasp}
            if self.cls == "defect":
                others = self.things(view, self.built.sound)
                count, middle = changed_px(stage.sight, things, others)
                words |= {"shows_px": count, "at_px": np.round(middle, 1).tolist()}
                words["visible"] = count >= MIN_SHOWN_PX
            words["T_world_part_true"] = rounded(stage.T_world @ view.T)
            shows.append(words)
        self.gains = self.fixed or self._gains(seen)
        rng = np.random.default_rng([self.seed, 1, self.number])
        pictures = [
            {
                name: develop(light.radiance[lamp], self.gains[name], self.sensor, rng)
                for lamp, name in view.stage.names.items()
            }
            for view, light in zip(self.views, seen, strict=True)
        ]
        self.trap: Words = {}
        return pictures, shows

    def _gains(self, seen: Sequence[Seen]) -> dict[str, float]:
        """Return the gain of each of the cell's lamps."""
        out = {}
        for stage in {id(view.stage): view.stage for view in self.views}.values():
            mine = [s for s, view in zip(seen, self.views, strict=True) if view.stage is stage]
            dark = [
                {lamp: s.radiance.get(lamp, s.radiance["ring"]) for lamp in LAMPS} for s in mine
            ]
            found = exposures(dark, [s.label for s in mine])
            out |= {name: found[lamp] for lamp, name in stage.names.items()}
        return out

    def believed(self) -> list[Array]:
        """Return the expected pose of the part in the world, view by view, as a run knows it."""
        rng = np.random.default_rng([self.seed, 2, self.number])
        middle = self.body.bounding_box.centroid
        holds: dict[int, Array] = {}
        out = []
        for i, view in enumerate(self.commanded):
            if view.grasp not in holds:
                T_inverse = inverse_pose(view.T)
                seen = T_inverse @ self.errors[i] @ view.T @ self.slips[view.grasp]
                play = (MEASURED_MM, MEASURED_DEG) if view.boxes else (SIGHTED_MM, SIGHTED_DEG)
                holds[view.grasp] = disturbed(seen, middle, *play, rng)
            out.append(view.stage.T_world @ view.T @ holds[view.grasp])
        return out

    def set_words(self, part: str) -> Words:
        """Return the set as a run writes it."""
        first = self.first
        recipe = load_recipe(first.recipe_path)
        mm, rad = MEASURED_HOLD
        views = []
        for number, (view, T) in enumerate(zip(self.commanded, self.believed(), strict=True)):
            is_held = bool(view.boxes)
            boxes = (WorldBox(view.stage.T_world @ box.T, box.half_mm) for box in view.boxes)
            pictures = {n: Path(f"v{number:02d}_{n}.png") for n in view.stage.names.values()}
            views.append(
                SetView(
                    id=view.name,
                    T_world_part=pose_rows(T),
                    prior_mm=mm,
                    prior_deg=float(np.degrees(rad)),
                    gripper_boxes=tuple(map(box_section, boxes)),
                    pictures=pictures,
                    grasp=view.grasp,
                    camera=None if is_held else camera_section(first.layout.overhead),
                    is_hold_measured=True,
                    planned=packed(view.in_sight),
                    only_planned=not is_held,
                )
            )
        cell = first.cell
        lamps = {n: light_of(lamp, cell) for n, lamp in cell.lamps.items() if n != TABLE_PANEL}
        words: Words = ViewSetFile(
            schema=SCHEMA,
            part=Path(part),
            unit="mm",
            camera=camera_section(first.layout.inspection),
            lamps={**lamps, TABLE_PANEL: table_light(cell)},
            views=tuple(views),
            recipe=recipe.model_copy(update={"part": Path(part), "cell": EMULATED_CELL.name}),
            unseen={u.face_id: u.reason for u in first.plan.unseen},
            sample_count=len(self.commanded[0].in_sight),
            accuracy=cell.accuracy,
        ).model_dump(mode="json", by_alias=True, exclude_none=True)
        return words


class PlannedSeries(Series):
    """A folder of pieces of one part in planned views."""

    def __init__(self, path: Path, part: str, seed: int, good: int) -> None:
        family, _, number = part.rpartition("_")
        self.part = drawn(family, int(number))
        self.first_kind = seed  # each folder begins with others
        super().__init__(path, seed, good)

    def begun(self) -> PlannedPart:
        """Return what all pieces share."""
        return PlannedPart(self.path, self.part, self.seed)

    def made(self, number: int, cls: str, kind: str, gains: dict[str, float] | None) -> Piece:
        """Return one piece."""
        return PlannedPiece(self.base, number, cls, kind, gains)


def main(argv: Sequence[str] | None = None) -> int:
    def series(path: Path, rest: str, good: int) -> PlannedSeries:
        part, _, seed = rest.partition(":")
        return PlannedSeries(path, part, int(seed), good)

    return trace(__doc__ or "", "FOLDER=PART:SEED", series, argv, counts="2 4")


if __name__ == "__main__":
    sys.exit(main())
