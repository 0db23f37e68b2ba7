"""Forecast of what a run will have compared, from the plan alone.

The pictures of the plan's views are predicted of a good, matt part, and judged as those of a run
are. So the share, the faces and the reasons are the inspection's own (ADR 120).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from controller import inspection as inspecting
from controller.arrays import BoolArray
from controller.cache import DiskCache, digest_of, source_hash, versions
from controller.planning import Look, Plan, Present
from controller.planning.model import lit_count
from controller.setup.holder import holder_boxes

from ...devices.lamps import STATION_LAMPS, TABLE_LAMPS
from .. import Context, inspection_limits
from ..tasks import held_task, table_task

FORMAT = 1  # to be raised when the meaning of stored forecasts changes
SOURCES = ("cad", "imaging", "inspection", "recognition", "setup")
DECIDING = ("numpy", "scipy", "opencv-python-headless", "trimesh", "embreex")


@dataclass(frozen=True, slots=True)
class ShortFace:
    """A face that will keep a good part from a PASS, with the reason."""

    face: int
    label: str
    area_mm2: float
    compared_fraction: float
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """What a run by a plan will have compared of a good part.

    Attributes
    ----------
    compared_fraction : share of the surface
    in_sight_fraction : share of the surface in sight, compared or not
    short_faces : faces that will keep the part from a PASS, the largest first
    """

    compared_fraction: float
    in_sight_fraction: float
    short_faces: tuple[ShortFace, ...]


def forecast(c: Context, plan: Plan) -> Forecast:
    """Return what a run by a plan will have compared, from the cache if it is there.

    Nothing that was learned of good parts is counted in.

    Parameters
    ----------
    c : recipe, cell and part
    plan : of this part in this cell
    """
    cache = DiskCache(Forecast, "forecast", "a forecast")
    asked = c.recipe.inspection.model_dump_json()
    key = digest_of(
        FORMAT,
        c.solid.content_hash,
        c.solid.unit,
        c.samples,
        plan,
        c.layout,
        c.cell.model_dump_json(),
        asked,
        _sources_hash(),
        versions(*DECIDING),
    )
    file = cache.file(c.solid.name, key)
    found = cache.load(file)
    if found is None:
        found = _forecast(c, plan)
        cache.save(file, found)
    return found


@lru_cache(maxsize=1)
def _sources_hash() -> str:
    root = Path(__file__).parents[3]
    return source_hash(*(root / name for name in SOURCES))


def _forecast(c: Context, plan: Plan) -> Forecast:
    views = tuple(_views(c, plan))
    wanted = c.recipe.inspection
    settings = inspecting.PartSettings(
        inspection_limits(c.recipe),
        min_coverage=wanted.min_coverage,
        not_inspected=c.not_inspected,
        unseen_reasons={piece.face_id: piece.reason for piece in plan.unseen},
        planned={s.view_id: s.seen for s in plan.steps if isinstance(s, Present | Look)},
        find_mm={str(kind): mm for kind, mm in wanted.find.items()},
    )
    found = inspecting.inspect_part(inspecting.ViewSet(c.posed, c.samples, views), (), settings)
    ledger = found.ledger
    short = [
        ShortFace(one.face_id, one.label, one.area_mm2, one.compared_fraction, one.reason)
        for one in ledger.faces
        if one.face_id in ledger.short_faces
    ]
    return Forecast(
        ledger.compared_fraction,
        ledger.in_sight_fraction,
        tuple(sorted(short, key=lambda one: (-one.area_mm2, one.face))),
    )


def _views(c: Context, plan: Plan) -> Iterator[inspecting.PicturedView]:
    """Yield the views of a plan with their predicted pictures."""
    held, number = "", 0
    for step in plan.steps:
        if isinstance(step, Look):
            task = table_task(c, step.view_id, step.T_world_part, TABLE_LAMPS[:1])
            yield _held(c, task, number, step.seen)
        elif isinstance(step, Present):
            number += step.grasp.id != held
            held = step.grasp.id
            boxes = holder_boxes(c.layout, step.q, step.expected_opening_mm)
            lamps = STATION_LAMPS[: lit_count(is_square=step.square_to >= 0)]
            task = held_task(
                c, step.view_id, step.T_world_part, boxes, lamps, is_hold_measured=True
            )
            yield _held(c, task, number, None)


def _held(
    c: Context, task: inspecting.ViewTask, number: int, counted: BoolArray | None
) -> inspecting.PicturedView:
    """Return a view with its predicted pictures, its pose known as well as once measured."""
    pictures = inspecting.predict_pictures(c.posed, task)
    return inspecting.PicturedView(
        task, pictures, number, *inspecting.MEASURED_HOLD, counted=counted
    )
