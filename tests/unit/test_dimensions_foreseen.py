"""An edge found where a shadow ends is no edge that has moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plate_pictures import HEIGHT_MM, NOMINAL, asked, length_edges, part, pictures, view
from scipy.special import expit

from controller.imaging import EdgeFits, PointLamp
from controller.inspection import PosedPart, WorldBox
from controller.inspection.characteristics import CharacteristicKind
from controller.inspection.dimensions import (
    BACKLIT,
    PosedView,
    Prediction,
    Rays,
    features_of,
    is_explained,
    measure,
    predict,
    shadow_shifts_px,
)

T = np.eye(4)
FAR_MM = 20_000.0  # a lamp so far away throws a sharp shadow


def slab(end_mm: float) -> WorldBox:
    """A finger whose shadow on the plate ends at x = end_mm, by light from -x at 45 deg."""
    at = np.eye(4)
    at[:3, 3] = [end_mm - 20.0 - 10.0, 0.0, HEIGHT_MM + 19.9]
    return WorldBox(at, np.array([10.0, 100.0, 0.1]))


def shaded(border_px: float) -> tuple[PosedPart, PosedView, Prediction]:
    """The plate before the camera; a finger's shadow ends so far beside the end at +x."""
    plate, bare = part(), view(pictures(NOMINAL, T), T)
    pixel_mm = bare.task.camera.mm_per_px(np.array([30.0, 0.0, HEIGHT_MM]))
    light = PointLamp("ring", np.array([[-FAR_MM, 0.0, FAR_MM]]))
    held = (slab(30.0 + border_px * pixel_mm),)
    seen = replace(bare, task=replace(bare.task, lamps=(light,), holder=held))
    wanted = asked(CharacteristicKind.LENGTH, length_edges(NOMINAL, plate.solid), 60.0)
    return plate, seen, predict(plate, seen, features_of(wanted))


def end_at_x(shown: Prediction) -> Rays:
    """The rays across the plate's end at +x, on the top face."""
    rays = shown.rays.chosen((shown.feature == 1) & (shown.curve == 0))
    assert (rays.normals[:, 0] > 0.9).all()
    return rays


@pytest.mark.parametrize(
    ("lamp", "place_px", "is_the_shadow"),
    [("ring", -4.0, True), ("ring", -7.0, False), ("ring", 4.0, False), (BACKLIT, -4.0, False)],
)
def test_where_a_shadow_ends_a_step_is_explained(
    lamp: str, place_px: float, is_the_shadow: bool
) -> None:
    plate, seen, shown = shaded(-4.0)
    rays = end_at_x(shown)
    place = np.full(len(rays.pixels), place_px)
    assert is_explained(plate, shown.scene, seen, lamp, rays, place) is is_the_shadow


@pytest.mark.parametrize(
    ("border_px", "contrast", "moved_px"),
    [
        (-1.0, -150.0, -1.0),  # as dark as what is behind the end: the step may be the shadow's
        (-2.0, -150.0, -2.0),
        (-2.0, -600.0, -0.5),  # a quarter as high as the step at the end
        (-7.0, -150.0, 0.0),
        (3.0, -150.0, 0.0),  # none on the plate
    ],
)
def test_a_shadow_beside_an_edge_moves_it_by_its_share_of_the_step(
    border_px: float, contrast: float, moved_px: float
) -> None:
    plate, seen, shown = shaded(border_px)
    rays = end_at_x(shown)
    even = np.ones(len(rays.pixels))
    found = EdgeFits(
        0 * even, even, 150.0 * even, contrast * even, 0 * even, even, 0 * even, 0 * even
    )
    moved = shadow_shifts_px(plate, shown.scene, seen, "ring", rays, found)
    assert np.median(moved) == pytest.approx(moved_px, abs=0.05)


def test_u_of_a_length_covers_a_shadow_taken_for_its_end() -> None:
    plate, seen, _ = shaded(-2.0)
    camera = seen.task.camera
    border_mm = 30.0 - 2.0 * camera.mm_per_px(np.array([30.0, 0.0, HEIGHT_MM]))
    column, _ = camera.project(np.array([[border_mm, 0.0, HEIGHT_MM]]))[0]
    pair = seen.pictures
    lit = pair.lit["ring"].astype(float)
    columns = np.arange(lit.shape[1])
    # bright up to the shadow, which is as dark as what is behind the end
    step = 170.0 - 150.0 * expit((columns - column) / 0.5)
    lit[:, columns > column - 40] = step[columns > column - 40]
    lit += np.random.default_rng(5).normal(0.0, 1.0, lit.shape)
    bright = np.clip(np.round(lit), 0, 255).astype(np.uint8)
    pictures_ = replace(pair, backlit=np.minimum(pair.backlit, 8), lit={"ring": bright})
    wanted = asked(CharacteristicKind.LENGTH, length_edges(NOMINAL, plate.solid), 60.0)
    off_in_u = {}
    for name, finger in (("even", slab(-200.0)), ("shaded", slab(border_mm))):
        task = replace(seen.task, holder=(finger,))
        (found,) = measure(plate, [wanted], [replace(seen, pictures=pictures_, task=task)])
        (look,) = [one for one in found.looks if one.lamp == "ring"]
        off_in_u[name] = abs(look.measured_mm - 60.0) / look.u_mm
    assert off_in_u["even"] > 3.0
    assert off_in_u["shaded"] < 2.0


def test_where_a_shadow_ends_beside_a_hidden_end_the_plate_has_no_length() -> None:
    plate, shown = part(), pictures(NOMINAL, T)
    bare = view(shown, T)
    pixel_mm = bare.task.camera.mm_per_px(np.array([30.0, 0.0, HEIGHT_MM]))
    border_mm = 30.0 - 4.0 * pixel_mm
    column, _ = bare.task.camera.project(np.array([[border_mm, 0.0, HEIGHT_MM]]))[0]
    # bright beyond the shadow, the plate like what is behind it: its own end does not show
    lit = shown.lit["ring"].astype(float)
    columns = np.arange(lit.shape[1])
    step = 20.0 + 150.0 * expit((columns - column) / 0.5)
    lit[:, columns > column - 40] = step[columns > column - 40]
    lit += np.random.default_rng(3).normal(0.0, 1.0, lit.shape)
    light = PointLamp("ring", np.array([[-FAR_MM, 0.0, FAR_MM]]))
    wanted = asked(CharacteristicKind.LENGTH, length_edges(NOMINAL, plate.solid), 60.0)
    bright = np.clip(np.round(lit), 0, 255).astype(np.uint8)
    pair = replace(bare.pictures, backlit=np.minimum(shown.backlit, 8), lit={"ring": bright})
    for finger, length_mm in ((slab(-200.0), 30.0 + border_mm), (slab(border_mm), None)):
        task = replace(bare.task, lamps=(light,), holder=(finger,))
        (found,) = measure(plate, [wanted], [replace(bare, pictures=pair, task=task)])
        if length_mm is None:
            assert found.measured_mm is None
            assert "shadow" in found.reason
        else:
            assert found.measured_mm == pytest.approx(length_mm, abs=0.1)
