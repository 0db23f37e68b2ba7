"""The views of a part from a set's file and its pictures, and the grasps that they share."""

from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from math import radians
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.cad.compiled import CompiledPart
from controller.config import ConfigError
from controller.config.view_set import PoseRows, SetCamera, SetView, ViewSetFile, unpacked
from controller.imaging import Camera, inverse_pose, rotation_angle, transform
from controller.inspection import (
    InspectionLimits,
    Kept,
    PartFacts,
    PicturedView,
    PosedPart,
    Same,
    ViewPictures,
    ViewSet,
    ViewTask,
    WorldBox,
)
from controller.setup.optics import build_light, light_corners
from controller.setup.turns import free_turn_of

# The expected pose of the part and the boxes of the gripper come from the same joints, so that
# within one grasp they agree to the arm's errors, some tenths at most. A regrasp moves a gripper by
# millimetres. One grasp taken for two only loses the information they share.
SAME_GRASP_MM: Final = 0.6
SAME_GRASP_RAD: Final = radians(0.6)
# An arm that is sent to the same view again reports joints that agree to some counts.
SAME_VIEW_MM: Final = 0.2
SAME_VIEW_RAD: Final = radians(0.2)
# Largest error of square axes; beyond it they were rounded or mistyped. At this value, which cell
# files may have, a metre is off by 3 um.
ROUNDED: Final = 3e-6
KEPT_CAMERAS: Final = 4  # cameras kept with their tables of lines of sight, for the next part

Pictures = Mapping[str, Mapping[str, Grey]]


def build_view_set(
    file: ViewSetFile,
    part: CompiledPart,
    pictures: Pictures,
    limits: InspectionLimits,
    kept: Kept | None = None,
) -> ViewSet:
    """Return the views of a part with their pictures.

    Parameters
    ----------
    file : the set
    part : its part
    pictures : by view id and lamp
    limits : limits of differences
    kept : the views of it that were built before are taken from here; None for none

    Raises
    ------
    ConfigError : the set's plan counts other samples than this part has, or the part is expected
        behind a camera
    """
    kept = kept or Kept()
    planned = planned_samples(file, part)
    # a camera's table of sight lines is worked out once for all its views
    cameras = {
        one: kept.once(partial(build_camera, one), build_camera, one)
        for one in {file.camera_of(view) for view in file.views}
    }
    tasks = [_task(file, view, cameras[file.camera_of(view)], limits) for view in file.views]
    _require_in_front(tasks, part)
    grasps = _grasps(file.views, tasks)
    views = tuple(
        kept.once(
            partial(_held, file, view, task, grasp, pictures[view.id], planned.get(view.id)),
            *(PicturedView, *_all_of(file, view), task.camera, limits, grasp),
            *(Same(pictures[view.id][lamp]) for lamp in view.pictures),
        )
        for view, task, grasp in zip(file.views, tasks, grasps, strict=True)
    )
    posed = kept.once(partial(PosedPart, part.solid), PosedPart, Same(part.solid))
    return ViewSet(posed, part.samples, views)


def _held(
    file: ViewSetFile,
    view: SetView,
    task: ViewTask,
    grasp: int,
    pictures: Mapping[str, Grey],
    planned: BoolArray | None,
) -> PicturedView:
    return PicturedView(
        task,
        _pictures(file, view, pictures),
        grasp,
        prior_mm=view.prior_mm,
        prior_rad=radians(view.prior_deg),
        counted=planned if view.only_planned else None,
    )


def _all_of(file: ViewSetFile, view: SetView) -> tuple[str, ...]:
    """Return all that a set states of a view except its camera: its own entry, lamps and codes."""
    return (
        view.model_dump_json(),
        repr(file.codes_mm),
        *(file.lamps[lamp].model_dump_json() for lamp in view.pictures),
    )


def grasp_numbers(file: ViewSetFile) -> dict[str, int]:
    """Return the number of the grasp of each view, by its id.

    Parameters
    ----------
    file : the set
    """
    tasks = [
        _task(file, view, build_camera(file.camera_of(view)), InspectionLimits())
        for view in file.views
    ]
    ids = [view.id for view in file.views]
    return dict(zip(ids, _grasps(file.views, tasks), strict=True))


def repeated_sets(file: ViewSetFile) -> tuple[ViewSetFile, ...]:
    """Return a set as several if all its views were taken equally often, else as one.

    Two views are the same view again where part and gripper are expected in the same pose, within
    the same grasp.

    Parameters
    ----------
    file : the set
    """
    grasps = grasp_numbers(file)
    again: list[list[SetView]] = []
    for view in file.views:
        for known in again:
            if grasps[known[0].id] == grasps[view.id] and _is_same_view(known[0], view):
                known.append(view)
                break
        else:
            again.append([view])
    counts = {len(known) for known in again}
    if len(counts) != 1 or counts <= {1}:
        return (file,)
    return tuple(
        file.model_copy(update={"views": tuple(known[k] for known in again)})
        for k in range(counts.pop())
    )


def _is_same_view(one: SetView, other: SetView) -> bool:
    T, T_other = build_pose(one.T_world_part), build_pose(other.T_world_part)
    return bool(
        one.pictures.keys() == other.pictures.keys()
        and np.linalg.norm(T[:3, 3] - T_other[:3, 3]) <= SAME_VIEW_MM
        and rotation_angle(T[:3, :3].T @ T_other[:3, :3]) <= SAME_VIEW_RAD
    )


def planned_samples(file: ViewSetFile, part: CompiledPart) -> dict[str, BoolArray]:
    """Return the planned samples (n,) of each view that names them, by view id.

    Raises
    ------
    ConfigError : the set counts other samples than this part has
    """
    count = len(part.samples.points_mm)
    if file.sample_count not in (None, count):
        raise ConfigError(
            f"`sample_count`: the set was written for {file.sample_count} samples of the surface, "
            f"{part.solid.name} has {count}: another part, or another version of cellctl"
        )
    return {
        view.id: unpacked(view.planned, count) for view in file.views if view.planned is not None
    }


def build_pose(rows: PoseRows) -> FloatArray:
    """Return a pose (4, 4), made rigid again if it was rounded when written."""
    T = np.array(rows, dtype=float)
    R = T[:3, :3]
    if np.abs(R.T @ R - np.eye(3)).max() > ROUNDED:
        left, _, right = np.linalg.svd(R)
        T[:3, :3] = left @ right
    return T


@lru_cache(maxsize=KEPT_CAMERAS)
def build_camera(camera: SetCamera) -> Camera:
    """Return the camera of a set, or of a view: the same one for the next set."""
    return Camera(
        camera.size_px,
        np.array(camera.K),
        np.array(camera.distortion),
        build_pose(camera.T_world_cam),
    )


def _task(file: ViewSetFile, view: SetView, camera: Camera, limits: InspectionLimits) -> ViewTask:
    panel = file.panel_of(view)
    assert panel is not None
    axis = camera.T_world_cam[:3, 2]
    return ViewTask(
        view_id=view.id,
        camera=camera,
        T_world_part_expected=build_pose(view.T_world_part),
        holder=tuple(
            WorldBox(build_pose(box.T), np.array(box.half_mm)) for box in view.gripper_boxes
        ),
        panel_mm=light_corners(panel, file.lamps[panel]),
        lamps=tuple(
            build_light(name, file.lamps[name], axis) for name in view.pictures if name != panel
        ),
        limits=limits,
        is_hold_measured=view.is_hold_measured,
        facts=PartFacts(
            tuple(np.array(corners) for corners in file.codes_mm or ()),
            free_turn_of(view.free_turn),
        ),
    )


def _require_in_front(tasks: Sequence[ViewTask], part: CompiledPart) -> None:
    """Raise ConfigError where a part, or a piece of it, is expected behind the camera."""
    vertices = np.asarray(part.solid.mesh.vertices, dtype=np.float64)
    for i, task in enumerate(tasks):
        before = transform(task.T_world_part_expected, vertices) - task.camera.position_mm
        depth_mm = float((before @ task.camera.T_world_cam[:3, 2]).min())
        if depth_mm <= 0:
            raise ConfigError(
                f"`views.{i}.T_world_part`: the part would reach {-depth_mm:.0f} mm behind the "
                "camera; `T_world_cam` looks along its z"
            )


def _pictures(file: ViewSetFile, view: SetView, of_view: Mapping[str, Grey]) -> ViewPictures:
    panel = file.panel_of(view)
    assert panel is not None
    return ViewPictures(
        backlit=of_view[panel],
        lit={lamp: picture for lamp, picture in of_view.items() if lamp != panel},
    )


def _grasps(views: Sequence[SetView], tasks: Sequence[ViewTask]) -> list[int]:
    """Return the number of the grasp of each view: the file's, else by the gripper's boxes."""
    taken = [view.grasp for view in views if view.grasp is not None]
    first_free = max(taken, default=-1) + 1
    known: list[ViewTask] = []  # the first view of each grasp
    numbers = []
    for view, task in zip(views, tasks, strict=True):
        if view.grasp is not None:
            numbers.append(view.grasp)
            continue
        same = [k for k, other in enumerate(known) if _is_same_grasp(task, other)]
        if not same:
            known.append(task)
        numbers.append(first_free + (same[0] if same else len(known) - 1))
    return numbers


def _is_same_grasp(one: ViewTask, other: ViewTask) -> bool:
    """Return True if the holder's boxes have the same poses relative to the part in both views."""
    if len(one.holder) != len(other.holder):
        return False
    to_one, to_other = (
        inverse_pose(one.T_world_part_expected),
        inverse_pose(other.T_world_part_expected),
    )
    for box, twin in zip(one.holder, other.holder, strict=True):
        T, T_twin = to_one @ box.T, to_other @ twin.T
        if np.linalg.norm(T[:3, 3] - T_twin[:3, 3]) > SAME_GRASP_MM:
            return False
        if rotation_angle(T[:3, :3].T @ T_twin[:3, :3]) > SAME_GRASP_RAD:
            return False
    return True
