"""The views of a part as a file beside its pictures, in the form that `cellctl inspect` reads.

The part is judged from this file, so that a replay uses the same numbers to the last bit.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import degrees
from pathlib import Path
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cell.devices.lamps import STATION_PANEL, TABLE_PANEL
from controller.cell.services.records import BatchProduct, PartRecord, Shown
from controller.config import Cell, split_cad
from controller.config.view_set import (
    SCHEMA,
    SetBox,
    SetCalibration,
    SetCamera,
    SetView,
    ViewSetFile,
    packed,
)
from controller.imaging import Camera, inverse_pose
from controller.inspection import MEASURED_HOLD, PLANNED_HOLD, WorldBox
from controller.planning import shown_pose
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from controller.setup.optics import light_of, table_light
from controller.setup.turns import turn_section

SAME_HOLD: Final = 1e-6  # rounding of pose products between a hold and the pose it was learned from


@dataclass(frozen=True, slots=True, eq=False)
class WrittenViews:
    """The file of a part's views.

    Attributes
    ----------
    file : relative to the run's folder
    digest : SHA-256 of the file
    """

    file: str
    digest: str


@dataclass(frozen=True, slots=True, eq=False)
class PartFileWriter:
    """Writes the views of a part to a file.

    Attributes
    ----------
    cell, layout : cell and layout of the run
    folder : folder of the run
    calibration : calibrations of the cell that no longer count
    """

    cell: Cell
    layout: CellLayout
    folder: Path
    calibration: SetCalibration = field(default_factory=SetCalibration)

    def path(self, part: PartRecord) -> Path:
        """Return the path of the file for a part's views."""
        return self.folder / f"part{part.number:03d}.views.json"

    def write(self, part: PartRecord, product: BatchProduct) -> WrittenViews:
        """Write the views of a part that were shown; return the file.

        Parameters
        ----------
        part : has the views
        product : product it belongs to

        Raises
        ------
        OSError : the file cannot be written
        """
        path = self.path(part)
        data = self.text(part, product, part.shown).encode()
        path.write_bytes(data)
        return WrittenViews(path.name, hashlib.sha256(data).hexdigest())

    def text(self, part: PartRecord, product: BatchProduct, views: Sequence[Shown]) -> str:
        """Return the content of a file for some of a part's views.

        Parameters
        ----------
        part : part that they belong to
        product : product it belongs to
        views : located, in the order shown
        """
        body = self._file(part, product, _in_common_holds(views, self.layout))
        return body.model_dump_json(by_alias=True, exclude_none=True, indent=1) + "\n"

    def _file(
        self, part: PartRecord, product: BatchProduct, numbered: Sequence[tuple[Shown, int]]
    ) -> ViewSetFile:
        masks = [mask for mask in part.planned.values() if len(mask)]
        lights = {
            name: light_of(lamp, self.cell)
            for name, lamp in self.cell.lamps.items()
            if name != TABLE_PANEL
        }
        learned = product.recipe.inspection.learned
        by_id = {shown.view: self._view(shown, number, part) for shown, number in numbered}
        return ViewSetFile(
            schema=SCHEMA,
            part=product.inputs / split_cad(product.recipe.part).name,
            unit=product.recipe.unit or "mm",
            camera=camera_section(self.layout.inspection),
            lamps={**lights, TABLE_PANEL: table_light(self.cell)},
            views=tuple(by_id.values()),
            recipe=product.recipe,
            unseen={} if part.plan is None else {u.face_id: u.reason for u in part.plan.unseen},
            sample_count=len(masks[0]) if masks else None,
            accuracy=self.cell.accuracy,
            calibration=self.calibration,
            learned=None if learned is None else product.inputs / learned.name,
            codes_mm=tuple(map(pose_rows, part.codes_mm)),
        )

    def _view(self, shown: Shown, number: int, part: PartRecord) -> SetView:
        is_held = shown.hold is not None
        mask = part.planned.get(shown.view)
        panel = STATION_PANEL if is_held else TABLE_PANEL
        files = part.files[shown.view]
        prior_mm, prior_rad = MEASURED_HOLD if shown.is_hold_measured else PLANNED_HOLD
        return SetView(
            id=shown.view,
            T_world_part=pose_rows(shown.expected),
            prior_mm=prior_mm,
            prior_deg=degrees(prior_rad),
            gripper_boxes=tuple(map(box_section, shown.holder)),
            pictures={lamp: Path(files[lamp]) for lamp in (panel, *shown.lamps)},
            grasp=number,
            camera=None if is_held else camera_section(self.layout.overhead),
            is_hold_measured=shown.is_hold_measured,
            planned=None if mask is None or not len(mask) else packed(mask),
            only_planned=not is_held,
            free_turn=turn_section(shown.facts.free_turn),
        )


def _in_common_holds(views: Sequence[Shown], layout: CellLayout) -> list[tuple[Shown, int]]:
    """Return views with the numbers of their grasps; those of one grasp share one hold.

    The first view of a grasp is taken where the plan expects the part; from then on the hold is
    known from that view. It is restated by the same hold, as all views of a grasp share it; and so
    are the views before the one that showed an open turn.
    """
    numbers: dict[tuple[int, bytes], int] = {}
    found = []
    for shown in views:
        twin, now = _learned(shown, views, layout), shown
        if twin is not None and twin.T_part_tcp is not None:
            now = replace(
                shown,
                expected=shown_pose(layout, shown.q, twin.T_part_tcp),
                T_part_tcp=twin.T_part_tcp,
                is_hold_measured=True,
                facts=twin.facts,
            )
        if now.hold is None or now.T_part_tcp is None:
            key = (id(now), b"")  # at rest on the table, each look on its own
        else:
            key = (id(now.hold), now.T_part_tcp.tobytes())
        found.append((now, numbers.setdefault(key, len(numbers))))
    return found


def _learned(shown: Shown, views: Sequence[Shown], layout: CellLayout) -> Shown | None:
    """Return a view with the T_part_tcp that was learned of a view's hold; None for nothing new."""
    is_open = shown.facts.is_turn_open
    if shown.hold is None or (shown.is_hold_measured and not is_open):
        return None
    known = [
        other
        for other in views
        if other.hold is shown.hold and other.is_hold_measured and not other.facts.is_turn_open
    ]
    pose = None if shown.located is None else shown.located.result()
    if not is_open and pose is not None and pose.evaluated:
        own = inverse_pose(pose.T_world_part) @ tcp_pose(layout, shown.q)
        known = [
            one
            for one in known
            if one.T_part_tcp is not None and np.allclose(one.T_part_tcp, own, atol=SAME_HOLD)
        ]
    elif not is_open:
        return None
    return known[0] if known else None


def camera_section(camera: Camera) -> SetCamera:
    """Return a camera in the format of a set of views."""
    k1, k2, p1, p2, k3 = camera.distortion.tolist()
    return SetCamera(
        size_px=camera.size_px,
        K=pose_rows(camera.K),
        distortion=(k1, k2, p1, p2, k3),
        T_world_cam=pose_rows(camera.T_world_cam),
    )


def box_section(box: WorldBox) -> SetBox:
    """Return a box of the gripper in the format of a set of views."""
    return SetBox(T=pose_rows(box.T), half_mm=tuple(box.half_mm.tolist()))


def pose_rows(T: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Return a matrix in the format of a set of views, row by row."""
    return tuple(tuple(float(x) for x in row) for row in T)
