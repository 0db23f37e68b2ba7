"""The first view of a new grasp shows the part's outline, by which the grasp is verified."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cad_solids import solid_of
from featured_parts import standing_shaft
from numpy.typing import NDArray
from planning_cell import emulated_layout

from controller.cad import sample_surface
from controller.planning import PlanOptions, Present, prepare_part, shown_pose
from controller.planning.geometry import Box
from controller.planning.motion import Scene
from controller.planning.planner.build import Build, Builder
from controller.planning.planner.confirming import shows_outline

LAYOUT = emulated_layout()
CUBE = np.array([(x, y, z) for x in (-15, 15) for y in (-15, 15) for z in (-15, 15)], float)


def behind(x_mm: float, half_mm: float) -> Any:
    """A scene whose arm is one box, so far behind a part at the station and beside it."""
    camera = LAYOUT.inspection
    T = np.eye(4)
    T[:3, :3] = camera.T_world_cam[:3, :3]
    T[:3, 3] = station_mm() + camera.T_world_cam[:3, 2] * 60.0 + camera.T_world_cam[:3, 0] * x_mm
    return SimpleNamespace(arm_boxes=lambda q: [Box(T, np.array([half_mm, half_mm, 5.0]))])


def station_mm() -> NDArray[np.float64]:
    return np.asarray(LAYOUT.station_mm)


@pytest.mark.parametrize(
    ("x_mm", "half_mm", "is_seen"),
    [(0.0, 60.0, False), (200.0, 60.0, True), (0.0, 8.0, True)],
    ids=["right behind it", "beside it", "behind its middle"],
)
def test_an_outline_is_seen_where_the_arm_is_not_behind_it(
    x_mm: float, half_mm: float, is_seen: bool
) -> None:
    T = np.eye(4)
    T[:3, 3] = station_mm()
    found = shows_outline(LAYOUT, behind(x_mm, half_mm), np.zeros(6), CUBE, T)
    assert found is is_seen


def test_a_grasp_of_which_views_before_the_arm_are_wanted_is_verified_by_another() -> None:
    solid = solid_of(standing_shaft(), "shaft")
    options = PlanOptions(arm_grasps_per_pose=4, arm_grasps_round=6, fixed_grasps=4)
    part = prepare_part(solid, sample_surface(solid, 5.0), LAYOUT, options)

    def is_seen(g: int, q: NDArray[np.float64]) -> bool:
        grasp = part.arm_grasps[g]
        scene = Scene(LAYOUT, grasp.opening_mm, LAYOUT.fixed_open_mm)
        T = shown_pose(LAYOUT, q, grasp.T_part_tcp)
        return shows_outline(LAYOUT, scene, q, solid.hull_mm, T)

    hidden = [
        (g, v)
        for g, views in enumerate(part.view_q)
        for v, rows in views.items()
        if not any(is_seen(g, q) for q in rows)
    ]
    assert hidden
    for g, v in hidden[:3]:
        build = Build(LAYOUT.park_q, np.zeros(len(part.samples.points_mm), dtype=bool))
        picked: Any = SimpleNamespace()  # a step that is no view
        build.steps.append(picked)
        Builder(part, LAYOUT, 0).show(build, g, [v], None)
        first, *rest = build.steps[1:]
        assert isinstance(first, Present)
        assert is_seen(g, first.q)
        wanted = f"{part.arm_grasps[g].id}-V{v}"
        assert [step.view_id for step in rest if isinstance(step, Present)] == [wanted]
