"""Views of the block in a gripper (`shown_part`) as edge evidence takes them, poses known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from cad_solids import Body
from shown_part import Array, hand, photograph, shown, task

from controller.inspection import WorldBox
from controller.inspection.dimensions import BACKLIT, PosedView
from controller.inspection.edge_evidence import EdgeView

KNOWN = np.diag([0.02] * 3 + [0.0003] * 3) ** 2  # a pose as well known as a fit's


def edge_views(
    body: Body,
    looks: tuple[tuple[float, float], ...],
    holder: Callable[[Array], tuple[WorldBox, ...]] = hand,
    grasp: str = "",
) -> list[EdgeView]:
    """Views of a real body, turned and tilted [deg], before the panel and under every lamp."""
    views = []
    for number, (turn, tilt) in enumerate(looks):
        T = shown(turn, tilt)
        pictures = photograph(body, T, holder(T))
        posed = PosedView(task(T, holder(T), f"{grasp}v{number}"), pictures, T, KNOWN)
        views.append(EdgeView(posed, (BACKLIT, *pictures.lit)))
    return views
