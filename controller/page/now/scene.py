"""The cell in three dimensions: static objects, the arm, the part now. mm.

Boxes are those of collision checks. Each has the half of its edges and a pose, (4, 4) row by row.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray
from controller.cell.custody import Custody
from controller.config import Cell
from controller.imaging import Camera
from controller.planning import Box, CellLayout
from controller.planning.motion import Scene, segment_seconds, shown_pose, tcp_pose
from controller.setup.layout import build_layout

from .fold import IN_ARM, HeldPart, JournaledArm, Path

Waypoints = tuple[tuple[float, ...], ...]

# Shares of a previewed motion at which the arm is drawn, and the spacing of the points of its TCP.
GHOST_SHARES: Final = (1 / 3, 2 / 3, 1.0)
TCP_POINT_COUNT: Final = 25
AXES: Final = 6

CONE_MM: Final = 200.0  # length drawn of the cone of a camera whose picture meets no table
TRAY_MM: Final = 4.0


@dataclass(frozen=True)
class CellScene:
    """The scene of one cell.

    Attributes
    ----------
    layout : the cell
    """

    layout: CellLayout

    @classmethod
    def of(cls, cell: Mapping[str, Any]) -> "CellScene":
        """Return the scene of a cell from a run's first row.

        Raises
        ------
        ValueError : it is not as this version writes it
        """
        return cls(build_layout(Cell.model_validate(dict(cell))))

    @cached_property
    def standing(self) -> dict[str, Any]:
        """Static objects, as JSON."""
        layout = self.layout
        trays = {
            name: Box.from_bounds(
                tray.centre_mm[0] - tray.size_mm[0] / 2,
                tray.centre_mm[0] + tray.size_mm[0] / 2,
                tray.centre_mm[1] - tray.size_mm[1] / 2,
                tray.centre_mm[1] + tray.size_mm[1] / 2,
                -TRAY_MM,
                0.0,
            )
            for name, tray in sorted(layout.trays.items())
        }
        return {
            "boxes": [
                _box("column", "arm", layout.column),
                *(_box(name, "obstacle", box) for name, box in sorted(layout.obstacles.items())),
                *(_box(name, f"tray {name}", box) for name, box in trays.items()),
            ],
            "cameras": [
                _cone("overhead", layout.overhead, None),
                _cone("inspection", layout.inspection, layout.station_mm),
            ],
            "station": layout.station_mm.tolist(),
            "moving": [
                {"name": name, "kind": kind, "half": [round(h, 2) for h in box.half_mm.tolist()]}
                for name, kind, box in self._moving(layout.park_q, None, None)
            ],
        }

    def moment(
        self, arm: JournaledArm, part: HeldPart, now_s: float, speed: float
    ) -> dict[str, Any]:
        """Return where arm and part are at a moment, as JSON.

        Parameters
        ----------
        arm, part : as the journal has them
        now_s : UTC, seconds since 1970
        speed : cell seconds per second
        """
        found = self.joints(arm, now_s, speed)
        q = self.layout.park_q if found is None else found
        return {
            "q": [round(value, 4) for value in q.tolist()],
            "known": found is not None,
            "moves": arm.path is not None,
            "T": [_pose(box.T) for _, _, box in self._moving(q, part.arm_mm, part.fixed_mm)],
            "part": self._part(part, q, found is not None),
        }

    def joints(self, arm: JournaledArm, now_s: float, speed: float) -> FloatArray | None:
        """Return the joints (6,) at a moment; None where they are unknown.

        On a path they are where the arm's timing model has them after that time, at the speed the
        run was started with; at its ends they are those of the journal.

        Parameters
        ----------
        arm : as the journal has it
        now_s : UTC, seconds since 1970
        speed : cell seconds per second
        """
        if arm.path is None:
            return None if arm.q is None else np.array(arm.q, dtype=float)
        return self._on_path(arm.path, (now_s - arm.path.began_s) * speed)

    def ghost(self, part: HeldPart, waypoints: Waypoints) -> dict[str, Any] | None:
        """Return where the arm comes along on a motion, as JSON; None where no path is known.

        Between two waypoints the joints go in proportion, as the arm drives them.

        Parameters
        ----------
        part : part as the journal has it; an object in the arm gripper is included
        waypoints : joints where the motion begins and ends, (6,) each
        """
        if len(waypoints) < 2 or any(len(q) != AXES for q in waypoints):
            return None
        points = np.array(waypoints, dtype=float)
        way = [
            a + share * (b - a)
            for a, b in pairwise(points)
            for share in np.linspace(0.0, 1.0, TCP_POINT_COUNT)
        ]
        begin, end = points[-2], points[-1]
        stops = [begin + share * (end - begin) for share in GHOST_SHARES]
        is_held = part.custody in IN_ARM and part.T_part_tcp is not None
        return {
            "tcp": [np.round(tcp_pose(self.layout, q)[:3, 3], 1).tolist() for q in way],
            "stops": [
                {
                    "T": [
                        _pose(box.T) for _, _, box in self._moving(q, part.arm_mm, part.fixed_mm)
                    ],
                    "part": self._held(q, part.T_part_tcp or ()) if is_held else None,
                }
                for q in stops
            ],
        }

    def _part(self, part: HeldPart, q: FloatArray, is_known: bool) -> list[float] | None:
        if part.custody in IN_ARM:
            is_held = is_known and part.T_part_tcp is not None
            return self._held(q, part.T_part_tcp or ()) if is_held else None
        if part.custody in (Custody.NONE, Custody.REMOVED, Custody.LOST):
            return None
        if part.let_go is not None:
            return self._held(np.array(part.let_go[0], dtype=float), part.let_go[1])
        if part.T_world_part is None:
            return None
        return _pose(np.array(part.T_world_part, dtype=float))

    def _held(self, q: FloatArray, T_part_tcp: Sequence[Sequence[float]]) -> list[float]:
        return _pose(shown_pose(self.layout, q, np.array(T_part_tcp, dtype=float)))

    def _on_path(self, path: Path, elapsed_s: float) -> FloatArray:
        points = np.array(
            [*([] if path.start is None else [path.start]), *path.waypoints], dtype=float
        )
        if len(points) < 2:
            return np.asarray(points[-1], dtype=float)
        ends = np.cumsum(
            [float(segment_seconds(self.layout, a, b)) for a, b in pairwise(points)]
        ).tolist()
        number = bisect_right(ends, elapsed_s)
        if number >= len(ends):
            return np.asarray(points[-1], dtype=float)
        before = ends[number - 1] if number else 0.0
        share = (elapsed_s - before) / max(ends[number] - before, 1e-6)
        # as the arm speeds up and slows down; a person sees no more of it than that
        share = float(np.clip(share, 0.0, 1.0)) ** 2 * (3 - 2 * float(np.clip(share, 0.0, 1.0)))
        return np.asarray(points[number] + share * (points[number + 1] - points[number]))

    def _moving(
        self, q: FloatArray, arm_mm: float | None, fixed_mm: float | None
    ) -> list[tuple[str, str, Box]]:
        layout = self.layout
        jaw = layout.arm_gripper
        boxes = Scene(layout, jaw.max_mm if arm_mm is None else arm_mm, 0.0).arm_boxes(q)
        links = [link.name for link in layout.arm.links]
        found = [(name, "arm", box) for name, box in zip(links, boxes, strict=False)]
        rest = boxes[len(links) :]
        body_count = len(jaw.body)
        found += [("arm gripper", "gripper", box) for box in rest[:body_count]]
        found += [("finger", "finger", box) for box in rest[body_count:]]
        if layout.fixed_gripper is not None:
            T = layout.T_world_fixed_tcp
            fixed = layout.fixed_gripper
            opening = fixed.max_mm if fixed_mm is None else fixed_mm
            found += [("fixed gripper", "fixed", box.placed(T)) for box in fixed.body]
            found += [("finger", "fixed finger", box.placed(T)) for box in fixed.fingers(opening)]
        return found


def _pose(T: FloatArray) -> list[float]:
    return [round(value, 4) for value in np.asarray(T, dtype=float).reshape(16).tolist()]


def _box(name: str, kind: str, box: Box) -> dict[str, Any]:
    half = [round(value, 2) for value in box.half_mm.tolist()]
    return {"name": name, "kind": kind, "half": half, "T": _pose(box.T)}


def _cone(name: str, camera: Camera, toward_mm: FloatArray | None) -> dict[str, Any]:
    """Return the cone of a camera: its eye, and where the corners of its picture come to lie."""
    width, height = camera.size_px
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float)
    eye = camera.position_mm
    if toward_mm is None:
        ends = camera.on_plane(corners)
    else:
        axis = camera.T_world_cam[:3, 2]
        depth = max(float((toward_mm - eye) @ axis), CONE_MM)
        ends = eye + depth * camera.sight_lines(corners)
    return {"name": name, "eye": eye.tolist(), "corners": np.round(ends, 2).tolist()}
