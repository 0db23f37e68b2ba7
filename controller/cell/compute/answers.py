"""The answers: one plain function for each question that the cell puts to its worker process.

`Compute` is made from these functions, so that a question has the name, arguments and documentation
of its function. Each function takes plain data and a `Job`, from which the worker builds, once, the
data that cannot be sent between processes (`job.context`). None of them moves anything.
"""

import hashlib
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from controller import inspection as inspecting
from controller import planning
from controller import recognition as recognising
from controller.arrays import BoolArray, FloatArray, Grey
from controller.cad.compiled import load_part
from controller.cell.custody import ALONE, Around
from controller.cell.journal.rows import SightingFields
from controller.config.view_set import load_view_set, parse_view_set
from controller.imaging import Camera, ViewMaps, inverse_pose, render_maps, transform, view_roi
from controller.imaging.codes import read_codes as find_codes
from controller.planning import (
    Ambiguity,
    Box,
    FaceToShowAgain,
    JointPath,
    OnTable,
    Plan,
    PreparedPart,
    Start,
    TableHypothesis,
)
from controller.planning.motion import (
    ProvenMove,
    Scene,
    Swept,
    connect,
    prove_move,
    prove_sweep,
)
from controller.planning.regrasps import pick_paths
from controller.stored import judge_ahead as stored_ahead
from controller.stored import judge_views, judging_of, read_pictures
from messages import key, say

from ..devices.lamps import TABLE_LAMPS
from ..plans import PlanCache
from . import held_search
from .job import MAX_RECIPE_COUNT, Context, Job, context
from .neighbours import layout_among
from .tasks import held_task, table_task

Holder = tuple[inspecting.WorldBox, ...]
MAX_LOCATED_COUNT: Final = 8
# Border round the part in which its code is sought: how far off its pose may be in a view that is
# not judged yet, with the quiet zone of a code at its rim.
CODE_MARGIN_PX: Final = 40


def recognise(job: Job, backlit: Grey, lit: Mapping[str, Grey]) -> tuple[recognising.Sighting, ...]:
    """Return the objects recognised on the table.

    Parameters
    ----------
    job : recipe and cell
    backlit : picture of the light table
    lit : pictures of the same by lamp
    """
    c = context(job)
    pictures = [lit[lamp] for lamp in TABLE_LAMPS if lamp in lit]
    seen = recognising.recognise(
        backlit, c.overhead, c.library, "backlit", usable=c.glowing, lit=pictures
    )
    return tuple(_read_as_wanted(s, c) for s in seen.sightings)


def _read_as_wanted(s: recognising.Sighting, c: Context) -> recognising.Sighting:
    """Return a sighting as the first part of the batch that matches; unchanged if it is one."""
    if s.part in c.wanted:
        return s
    may_be = {one.part for one in s.ambiguous_with}
    name = next((name for name in c.wanted if name in may_be), None)
    return s if name is None else s.read_as(name, c.library)


@dataclass(frozen=True, eq=False, slots=True)
class SeenCode:
    """A code in pictures of the part.

    Attributes
    ----------
    text, fields : all it says; by identifier, where it has fields
    picture : number of the first picture that shows it
    corners_mm : (4, 3) corners in the part frame; None beside the part
    """

    text: str
    fields: Mapping[str, str]
    picture: int
    corners_mm: FloatArray | None


def read_codes(
    job: Job, pictures: tuple[Grey, ...], T_world_part: FloatArray, *, is_held: bool
) -> tuple[SeenCode, ...]:
    """Return the codes that pictures of one view show, each text once.

    Parameters
    ----------
    job : recipe, which names the symbology and where the code is, and cell
    pictures : (height, width) each, under one lamp or another
    T_world_part : (4, 4) pose of the part there
    is_held : before the inspection camera; otherwise on the table
    """
    c = context(job)
    asked = c.recipe.serial_code
    camera = c.inspection if is_held else c.overhead
    roi = view_roi(c.solid.mesh.vertices, T_world_part, camera, CODE_MARGIN_PX)
    if asked is None or roi is None:
        return ()
    maps = render_maps(c.posed.caster, T_world_part, camera, roi)
    x0, y0, x1, y1 = roi if asked.at == "part" else (0, 0, *camera.size_px)
    found: dict[str, SeenCode] = {}
    for number, picture in enumerate(pictures):
        for code in find_codes(picture[y0:y1, x0:x1], (asked.code,)):
            corners_px = code.corners_px + np.array((x0, y0))
            corners_mm = _on_part(c, maps, T_world_part, camera, corners_px)
            if (corners_mm is None) == (asked.at == "beside"):
                found.setdefault(
                    code.text, SeenCode(code.text, dict(code.fields), number, corners_mm)
                )
    return tuple(found.values())


def _on_part(
    c: Context, maps: ViewMaps, T_world_part: FloatArray, camera: Camera, corners_px: FloatArray
) -> FloatArray | None:
    """Return the corners (4, 3) of a code in the part frame; None if its middle is not on it."""
    x, y = np.round(corners_px.mean(axis=0)).astype(int) - maps.roi[:2]
    height, width = maps.triangle.shape
    if not (0 <= x < width and 0 <= y < height) or maps.triangle[y, x] < 0:
        return None
    triangle = maps.triangle[y, x]
    T_part_world = inverse_pose(T_world_part)
    eye = transform(T_part_world, camera.position_mm[None])[0]
    lines = camera.sight_lines(corners_px) @ T_part_world[:3, :3].T
    normal = c.solid.mesh.face_normals[triangle]
    on_face = c.solid.mesh.triangles[triangle][0]
    far = ((on_face - eye) @ normal) / (lines @ normal)
    corners_mm: FloatArray = eye + far[:, None] * lines
    return corners_mm


def prepare(job: Job) -> float:
    """Do all planning that does not depend on the part's pose; return the duration [s]."""
    started = time.monotonic()
    _prepared(job)
    return time.monotonic() - started


def plan(
    job: Job,
    start: Start,
    seen: BoolArray | None,
    avoid: frozenset[str],
    alternatives: tuple[recognising.Alternative, ...],
    around: Around = ALONE,
    short: frozenset[FaceToShowAgain] = frozenset(),
) -> Plan:
    """Return a plan for the part, which a gripper or the table has.

    Parameters
    ----------
    job : recipe and cell
    start : present state of the part
    seen : (n,) bool, samples that need not be shown again
    avoid : ids of grasps that have failed
    alternatives : the other parts and poses that recognition has not excluded
    around : other objects in the cell
    short : faces to show again, from other grasps

    Raises
    ------
    NoPlanError : there is no plan; the message gives the reason
    """
    prepared, layout = _prepared(job), layout_among(context(job), around)
    if isinstance(start, OnTable) and alternatives:
        hypotheses = _hypotheses(job, alternatives)
        return planning.plan_under_ambiguity(
            prepared, layout, start, hypotheses, seen=seen, avoid=avoid
        )
    return planning.plan_from(prepared, layout, start, seen=seen, avoid=avoid, short=short)


@dataclass(frozen=True, slots=True)
class Pickable:
    """The ways to take a part from among the other objects on the table.

    Attributes
    ----------
    path_count : paths a gripper has to it; 0 where it cannot be taken
    forecast_s : duration of its inspection by the certificate of its stable pose [cell s]
    """

    path_count: int = 0
    forecast_s: float = math.inf


def pickable(job: Job, sightings: tuple[SightingFields, ...]) -> tuple[Pickable, ...]:
    """Return the ways to take each part from among the others; other recipes' parts have none.

    Parameters
    ----------
    job : recipe and cell
    sightings : all sightings on the table
    """
    name, prepared = context(job).solid.name, _prepared(job)
    found = []
    for number, seen in enumerate(sightings):
        others = (*sightings[:number], *sightings[number + 1 :])
        count = 0
        if seen.part == name and seen.T_world_part is not None:
            with suppress(planning.NoPlanError):
                paths = pick_paths(
                    prepared,
                    layout_among(context(job), Around(others)),
                    np.array(seen.T_world_part),
                )
                count = len(paths)
        forecast_s = _forecasts(job).get(seen.pose_index, math.inf) if count else math.inf
        found.append(Pickable(count, forecast_s))
    return tuple(found)


@lru_cache(maxsize=MAX_RECIPE_COUNT)
def _forecasts(job: Job) -> Mapping[int, float]:
    """Return the forecast duration [cell s] per stable pose with a certificate."""
    c = context(job)
    cache = PlanCache(c.part, c.layout, c.setup.options)
    plans = {pose.index: cache.known_plan(pose) for pose in c.poses}
    return {index: plan.forecast_s for index, plan in plans.items() if plan is not None}


def unseen_turns(
    job: Job, sightings: tuple[SightingFields, ...]
) -> tuple[tuple[float, ...] | None, ...]:
    """Return the turns about the vertical [deg] under which each object looks the same, 0 first.

    None means any turn. An unknown object has the turn 0 only.

    Parameters
    ----------
    job : recipe and cell
    sightings : objects on the table
    """
    entries = {entry.name: entry for entry in context(job).library.entries}
    found: list[tuple[float, ...] | None] = []
    for seen in sightings:
        entry = None if seen.part is None else entries.get(seen.part)
        turns = np.zeros(1) if entry is None else entry.turns_of(seen.pose_index)
        found.append(tuple(np.degrees(turns).tolist()) if len(turns) else None)
    return tuple(found)


def plan_to_trays(job: Job, start: Start, avoid: frozenset[str], around: Around = ALONE) -> Plan:
    """Return a plan that brings the part to a tray without showing it on the way.

    Parameters
    ----------
    job : recipe and cell
    start : present state of the part
    avoid : ids of grasps that have failed
    around : other objects in the cell

    Raises
    ------
    NoPlanError : no path leads to the trays; the message gives the reason
    """
    prepared = _prepared(job)
    nothing_left = np.ones(len(prepared.counted_samples.points_mm), dtype=bool)
    layout = layout_among(context(job), around)
    return planning.plan_from(prepared, layout, start, seen=nothing_left, avoid=avoid)


def _hypotheses(
    job: Job, alternatives: tuple[recognising.Alternative, ...]
) -> list[TableHypothesis]:
    """Return each other hypothesis about the picture, with the solid of its part."""
    c = context(job)
    rest = (load_part(*file) for file in c.files)
    solids = {part.solid.name: part.solid for part in (*rest, c.part)}
    return [TableHypothesis(a.part, solids[a.part], a.T_world_part) for a in alternatives]


def identify(
    job: Job,
    ambiguity: Ambiguity,
    q: FloatArray,
    opening_mm: float,
    backlit: Grey,
    lit: tuple[Grey, ...],
) -> tuple[int, ...]:
    """Return the hypotheses that agree with the pictures of the disambiguation view; () if none.

    Parameters
    ----------
    job : recipe and cell
    ambiguity : the hypotheses, and the view that decides between them
    q : (6,) configuration of the arm
    opening_mm : opening of the arm gripper
    backlit, lit : pictures of the view
    """
    return planning.identify(ambiguity, context(job).layout, q, opening_mm, backlit, lit).left


def path_home(
    job: Job,
    q: FloatArray,
    arm_opening_mm: float,
    fixed_opening_mm: float,
    T_part_tcp: FloatArray | None,
    around: Around = ALONE,
) -> JointPath:
    """Return a joint path from any configuration to the park position.

    Parameters
    ----------
    job : recipe and cell
    q : (6,) configuration of the arm
    arm_opening_mm, fixed_opening_mm : openings of both grippers
    T_part_tcp : (4, 4) pose of a part that may still be in the arm gripper, or None
    around : other objects in the cell

    Raises
    ------
    NoMotionError : no path is free of contact
    """
    c = context(job)
    carried = None if T_part_tcp is None else _part_box(job, inverse_pose(T_part_tcp))
    scene = Scene(layout_among(c, around), arm_opening_mm, fixed_opening_mm, carried)
    return connect(q, c.layout.park_q, scene, say("{name}: path home", name=c.solid.name))


def homing_swept(
    job: Job,
    low: FloatArray,
    high: FloatArray,
    arm_opening_mm: float | None,
    T_part_tcp: FloatArray | None,
    fixed_opening_mm: float,
    T_part_fixed: FloatArray | None,
    around: Around = ALONE,
) -> Swept:
    """Return whether homing without opening a jaw is free of contact all the way.

    Parameters
    ----------
    job : recipe and cell
    low, high : (6,) bounds of where the arm stands
    arm_opening_mm : opening of the arm gripper on the part; None for an empty one, however wide
    T_part_tcp : (4, 4) pose of a part in the arm gripper, or None
    fixed_opening_mm : opening of the fixed gripper
    T_part_fixed : (4, 4) T_part_tcp of a part in the fixed gripper, or None
    around : other objects in the cell
    """
    layout = layout_among(context(job), around)
    phases = layout.arm.homing_sweep(low, high)
    if not phases:
        return Swept(
            phase=key("it homes"), touches=key("everything: this arm has no homing with a part")
        )
    carried, standing = _held(job, T_part_tcp, T_part_fixed)
    # an empty gripper may stand at any opening: its fingers reach furthest when it is wide open,
    # and stand between when it is shut
    openings = (layout.arm_gripper.max_mm, 0.0) if arm_opening_mm is None else (arm_opening_mm,)
    swept = Swept()
    for opening_mm in openings:
        scene = Scene(layout, opening_mm, fixed_opening_mm, carried, standing)
        swept = prove_sweep(scene, phases)
        if not swept.is_free:
            break
    return swept


def proven_back(
    job: Job,
    q: FloatArray,
    q_begin: FloatArray,
    arm_opening_mm: float,
    T_part_tcp: FloatArray | None,
    fixed_opening_mm: float,
    T_part_fixed: FloatArray | None,
    around: Around = ALONE,
) -> ProvenMove:
    """Return the move back to its start, free of contact whichever axis goes first.

    Parameters
    ----------
    job : recipe and cell
    q : (6,) present joints of the arm
    q_begin : (6,) joints at the start of its move
    arm_opening_mm, fixed_opening_mm : openings of the two grippers
    T_part_tcp : (4, 4) pose of a part in the arm gripper, or None
    T_part_fixed : (4, 4) T_part_tcp of a part in the fixed gripper, or None
    around : other objects in the cell
    """
    layout = layout_among(context(job), around)
    carried, standing = _held(job, T_part_tcp, T_part_fixed)
    scene = Scene(layout, arm_opening_mm, fixed_opening_mm, carried, standing)
    return prove_move(scene, q, q_begin)


def _held(
    job: Job, T_part_tcp: FloatArray | None, T_part_fixed: FloatArray | None
) -> tuple[Box | None, tuple[Box, ...]]:
    """Return a part in the arm gripper in the TCP frame, and one in the fixed gripper's jaws."""
    carried = None if T_part_tcp is None else _part_box(job, inverse_pose(T_part_tcp))
    if T_part_fixed is None:
        return carried, ()
    T_world_part = context(job).layout.T_world_fixed_tcp @ inverse_pose(T_part_fixed)
    return carried, (_part_box(job, T_world_part),)


def _part_box(job: Job, T: FloatArray) -> Box:
    """Return the part's bounding box, placed by T (4, 4)."""
    low, high = context(job).solid.mesh.bounds
    return Box.from_bounds(*np.column_stack([low, high]).ravel()).placed(T)


def surface_share(job: Job, samples: BoolArray) -> float:
    """Return the share of the part's surface that the given samples (n,) stand for, 0..1."""
    areas = context(job).samples.areas_mm2
    return float(areas[samples].sum() / areas.sum())


@lru_cache(maxsize=MAX_RECIPE_COUNT)
def _prepared(job: Job) -> PreparedPart:
    c = context(job)
    return PlanCache(c.part, c.layout, c.setup.options).prepared()


@dataclass(frozen=True, eq=False, slots=True)
class Located:
    """The pose of the part in the arm gripper by one view, for the arm to go on with.

    Attributes
    ----------
    evaluated : the view shows it where it may be; otherwise `reason` says why not
    T_world_part : (4, 4) measured; the expected one where it is not evaluated
    """

    evaluated: bool
    reason: str
    T_world_part: FloatArray


def locate(
    job: Job,
    view_id: str,
    T_world_part: FloatArray,
    holder: Holder,
    backlit: Grey,
    lit: Mapping[str, Grey],
    is_hold_measured: bool,
    codes_mm: tuple[FloatArray, ...] = (),
) -> Located:
    """Return the pose of the part in the arm gripper, as located in one view.

    It is the quick half of `inspect`, which continues from it.

    Parameters
    ----------
    job : recipe and cell
    view_id : id of the view
    T_world_part : (4, 4) expected pose of the part
    holder : objects of the cell that may be in the picture
    backlit, lit : pictures in front of the backlight panel, and by lamp
    is_hold_measured : an earlier view has confirmed how the part is held
    codes_mm : corners (4, 3) of codes on the part, CAD frame
    """
    task = held_task(
        context(job), view_id, T_world_part, holder, tuple(lit),
        is_hold_measured=is_hold_measured, codes_mm=codes_mm,
    )  # fmt: skip
    pictures = inspecting.ViewPictures(backlit=backlit, lit=lit)
    found = inspecting.locate_view(context(job).posed, task, pictures)
    _located[_view_key(job, view_id, T_world_part, backlit)] = found
    if len(_located) > MAX_LOCATED_COUNT:
        _located.pop(next(iter(_located)))
    if isinstance(found, inspecting.NotEvaluated):
        return Located(False, found.reason, T_world_part)
    return Located(True, "", found.fit.T_world_part)


# What `locate` found last, for `inspect` to go on from; ten megabytes each.
_located: dict[tuple[object, ...], inspecting.CheckedView | inspecting.NotEvaluated] = {}


def _view_key(
    job: Job, view_id: str, T_world_part: FloatArray, backlit: Grey
) -> tuple[object, ...]:
    return job, view_id, T_world_part.tobytes(), hashlib.sha256(backlit.tobytes()).digest()


def inspect(
    job: Job,
    view_id: str,
    T_world_part: FloatArray,
    holder: Holder,
    backlit: Grey,
    lit: Mapping[str, Grey],
    is_hold_measured: bool,
    codes_mm: tuple[FloatArray, ...] = (),
) -> inspecting.ViewResult:
    """Return the result of one view of the part in the arm gripper.

    Parameters
    ----------
    job : recipe and cell
    view_id : id of the view
    T_world_part : (4, 4) expected pose of the part
    holder : objects of the cell that may be in the picture
    backlit, lit : pictures in front of the backlight panel, and by lamp
    is_hold_measured : an earlier view has confirmed how the part is held
    codes_mm : corners (4, 3) of codes on the part, CAD frame
    """
    task = held_task(
        context(job), view_id, T_world_part, holder, tuple(lit),
        is_hold_measured=is_hold_measured, codes_mm=codes_mm,
    )  # fmt: skip
    located = _located.pop(_view_key(job, view_id, T_world_part, backlit), None)
    return _inspected(context(job), task, backlit, lit, located)


def inspect_on_table(
    job: Job,
    view_id: str,
    T_world_part: FloatArray,
    backlit: Grey,
    lit: Mapping[str, Grey],
    codes_mm: tuple[FloatArray, ...] = (),
) -> inspecting.ViewResult:
    """Return the table pictures' result as a view; nothing hides the part there.

    Parameters
    ----------
    job : recipe and cell
    view_id : id of the view
    T_world_part : (4, 4) pose of the part
    backlit, lit : pictures of the light table, and by lamp
    codes_mm : corners (4, 3) of codes on the part, CAD frame
    """
    c = context(job)
    return _inspected(c, table_task(c, view_id, T_world_part, tuple(lit), codes_mm), backlit, lit)


def _inspected(
    c: Context,
    task: inspecting.ViewTask,
    backlit: Grey,
    lit: Mapping[str, Grey],
    located: inspecting.CheckedView | inspecting.NotEvaluated | None = None,
) -> inspecting.ViewResult:
    pictures = inspecting.ViewPictures(backlit=backlit, lit=lit)
    return _with_faces(c, inspecting.inspect_view(c.posed, c.samples, task, pictures, located))


def _with_faces(c: Context, result: inspecting.ViewResult) -> inspecting.ViewResult:
    """Return the result of a view, with the CAD face of each sample."""
    return replace(result, face_ids=c.samples.face_ids)


def find_hold(
    job: Job,
    T_world_part: FloatArray,
    T_part_tcp: FloatArray,
    holder: Holder,
    backlit: Grey,
) -> FloatArray | None:
    """Return T_world_part (4, 4) of a held part away from its expected pose; None if not found.

    Parameters
    ----------
    job : recipe and cell
    T_world_part : (4, 4) expected pose of the part
    T_part_tcp : (4, 4) intended grasp
    holder : objects of the cell that may be in the picture
    backlit : picture in front of the backlight panel
    """
    c = context(job)
    task = held_task(c, "hold", T_world_part, holder, (), is_hold_measured=False)
    return held_search.find_hold(c.posed, c.samples, task, T_part_tcp, backlit)


def judge_ahead(job: Job, set_path: Path, text: str, view_count: int) -> bool:
    """Do a piece of `judge`'s work in advance; return whether there may be more.

    Parameters
    ----------
    job : recipe and cell
    set_path : the file of the part's views, to be written
    text : state of the inspection so far, over all grasps that are over
    view_count : number of views planned

    Raises
    ------
    ConfigError : a picture that was stored cannot be read again
    """
    kept = _kept(set_path)
    before = kept.count
    # what was worked out before takes no time, and is no piece
    return any(kept.count > before for _ in _work_at_hand(job, set_path, text, view_count))


def judge(job: Job, set_path: Path) -> inspecting.PartInspection:
    """Return the inspection of a part from all its views.

    Parameters
    ----------
    job : recipe and cell
    set_path : the file of its views

    Raises
    ------
    ConfigError : a picture that was stored cannot be read again
    """
    file, kept = load_view_set(set_path), _kept(set_path)
    _kept.cache_clear()
    _work_at_hand.cache_clear()
    pictures = read_pictures(set_path, file, kept)
    judging = judging_of(set_path, file, None)
    found = judge_views(file, context(job).part, pictures, judging, kept)
    return replace(found, views=tuple(_with_faces(context(job), one) for one in found.views))


@lru_cache(maxsize=1)
def _kept(set_path: Path) -> inspecting.Kept:
    """Return the intermediate results kept for one part; those of the part before are dropped."""
    return inspecting.Kept()


@lru_cache(maxsize=1)
def _work_at_hand(job: Job, set_path: Path, text: str, view_count: int) -> Iterator[None]:
    """Return the work on some views; it goes on where its last piece ended.

    A view's pictures at its pose are large, and live from its first comparison to its last.
    """
    file = parse_view_set(set_path, text)
    judging = judging_of(set_path, file, None)
    return stored_ahead(file, context(job).part, judging, _kept(set_path), view_count)
