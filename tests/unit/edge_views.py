"""Views of the block in a gripper (`shown_part`) as edge evidence takes them, poses known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from cad_solids import Body
from shown_part import Array, hand, photograph, shown, task

from controller.cad import SurfaceSamples
from controller.inspection import InspectionLimits, PosedPart, WorldBox
from controller.inspection.dimensions import MeasuringSettings, PosedView
from controller.inspection.edge_evidence import (
    EdgeEvidence,
    find_evidence,
    look_at_edges,
)
from controller.inspection.integrity import Allowances, allowed_mm
from controller.inspection.kept import Kept
from controller.inspection.stages import edges_seen

KNOWN = np.diag([0.02] * 3 + [0.0003] * 3) ** 2  # a pose as well known as a fit's


def edge_views(
    body: Body,
    looks: tuple[tuple[float, ...], ...],
    holder: Callable[[Array], tuple[WorldBox, ...]] = hand,
    grasp: str = "",
) -> list[PosedView]:
    """Views of a real body, turned, tilted, spun [deg], before the panel and under every lamp."""
    views = []
    for number, look in enumerate(looks):
        T = shown(*look)
        pictures = photograph(body, T, holder(T))
        views.append(PosedView(task(T, holder(T), f"{grasp}v{number}"), pictures, T, KNOWN))
    return views


def evidence_of(
    part: PosedPart,
    samples: SurfaceSamples,
    views: list[PosedView],
    limits: InspectionLimits,
) -> EdgeEvidence:
    """The evidence of a part's edges in all of some views, under the defaults."""
    allowances, settings = Allowances(), MeasuringSettings()
    edges = edges_seen(part, views, Kept())
    allowed = allowed_mm(part, allowances.tolerance_class)
    looks = [
        look_at_edges(part, edges, view, allowed, settings) for view in views if edges is not None
    ]
    return find_evidence(part, samples, views, edges, looks, limits, allowances, settings)
