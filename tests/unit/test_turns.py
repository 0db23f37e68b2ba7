"""A shaft that stands on its end: from above its turn does not show, from the side it does."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from featured_parts import standing_shaft
from lit_pictures import Renderer, Scene, placed
from numpy.typing import NDArray
from shown_part import photograph, task
from table_pictures import overhead, resting

from controller.cad import Solid, sample_surface
from controller.cad.compiled import compile_solid
from controller.imaging import PointLamp, rotation_angle
from controller.inspection import (
    NotEvaluated,
    PartFacts,
    PicturedView,
    PosedPart,
    ViewPictures,
    ViewSet,
    inspect_view,
    locate_view,
)
from controller.inspection.grasp_pose import OutlinedView, PoseSettings
from controller.inspection.stages import pose_views
from controller.recognition import FreeTurn, Sighting, make_library, recognise

Array = NDArray[np.float64]
TABLE_CAMERA = overhead()
TABLE = np.array([[-150.0, -120, 0], [150, -120, 0], [150, 120, 0], [-150, 120, 0]])
LAMPS = [
    PointLamp.ring("ring", np.array([0.0, 0, 690]), np.array([0.0, 0, -1]), 120.0),
    PointLamp("side", np.array([[400.0, 350, 450]])),
]
AXIS = np.array([0.0, 0.0, 1.0])
# part z up before the station's camera, which looks along world y
UPRIGHT = np.eye(3)


def disc(pocket: Body | None = None) -> Body:
    body = rod(24, 14, 192).translate((0, 0, 7))
    return body if pocket is None else body - pocket


@cache
def solid(name: str) -> Solid:
    bodies = {
        "shaft": standing_shaft(),
        "disc": disc(),
        "pocketed": disc(box(16, 7, 8).translate((11, 0, 12))),
        "keyed": disc(box(12, 8, 40).translate((22, 0, 7))),
    }
    return solid_of(bodies[name], name)


def on_table(name: str, theta_rad: float) -> Sighting:
    """What is recognised of a part upright on the light table, by its pictures there."""
    of = solid(name)
    T = resting(of, np.eye(3), 14.0, -9.0, theta_rad)
    shots = Renderer(Scene(placed(of.mesh, T), None, TABLE), TABLE_CAMERA, seed=2)
    library = make_library([compile_solid(of)], TABLE_CAMERA)
    lit = [shots.lit(lamp) for lamp in LAMPS]
    (found,) = recognise(shots.backlit(), TABLE_CAMERA, library, lit=lit).sightings
    assert found.part == name
    return found


@cache
def lying(name: str) -> Solid:
    """A stepped shaft along z that rolls on its side; `keyed` shows in its outline at no roll."""
    body = rod(11, 22, 192).translate((0, 0, 11)) + rod(14, 26, 192).translate((0, 0, 35))
    body += rod(9, 24, 192).translate((0, 0, 60))
    return solid_of(body - box(5, 8, 14).translate((0, 7.5, 60)) if name == "keyed" else body, name)


def rolled(name: str, roll_rad: float) -> tuple[Sighting, Array]:
    """What is recognised of a shaft on its side, and its pose."""
    of = lying(name)
    part = compile_solid(of)
    pose = next(pose for pose in part.poses if pose.rolling)
    T = resting(of, pose.R @ cv2.Rodrigues(roll_rad * AXIS)[0], 12.0, -6.0, 0.7)
    shots = Renderer(Scene(placed(of.mesh, T), None, TABLE), TABLE_CAMERA, seed=3)
    library = make_library([part], TABLE_CAMERA)
    lit = [shots.lit(lamp) for lamp in LAMPS]
    (found,) = recognise(shots.backlit(), TABLE_CAMERA, library, lit=lit).sightings
    assert found.part == name
    return found, T


@pytest.mark.parametrize("roll_rad", [0.0, 0.9, 2.5])
def test_of_a_shaft_on_its_side_all_is_known_but_its_roll(roll_rad: float) -> None:
    found, T = rolled("keyed", roll_rad)
    assert found.T_world_part is not None
    assert found.free_turn is not None
    axis = found.free_turn.axis
    assert abs(float(axis @ AXIS)) == pytest.approx(1.0, abs=1e-6)
    assert found.is_roll_free
    assert not found.is_turn_free
    along = float(found.T_world_part[:3, :3] @ axis @ T[:3, :3] @ axis)
    assert along > np.cos(np.radians(0.3))
    assert found.sigma_rad < np.radians(0.5)  # that of its turn about the vertical
    away = found.T_world_part @ [0, 0, 35, 1] - T @ [0, 0, 35, 1]
    assert np.linalg.norm(away) < 0.3


def test_the_roll_of_a_round_part_is_no_question() -> None:
    found, _ = rolled("round", 0.9)
    assert found.free_turn is None


def test_a_standing_shaft_is_known_and_its_turn_is_not() -> None:
    found = on_table("shaft", 0.8)
    assert found.score > 0.9
    assert found.is_turn_free
    assert found.ambiguous_with == ()
    assert found.sigma_rad == pytest.approx(np.pi / np.sqrt(3))  # of an angle that may be any
    free = found.free_turn
    assert free is not None
    assert abs(float(free.axis @ AXIS)) == pytest.approx(1.0, abs=1e-6)
    assert np.linalg.norm(free.through_mm[:2]) < 0.1


def test_a_shaft_that_was_set_down_has_the_turn_in_which_it_was() -> None:
    found = on_table("shaft", 0.8)
    true = resting(solid("shaft"), np.eye(3), 14.0, -9.0, 0.8)
    read = found.laid(true)
    assert read.T_world_part is not None
    np.testing.assert_allclose(read.T_world_part, true, atol=0.15)
    assert read.theta_rad == pytest.approx(0.8, abs=0.01)
    assert read.free_turn is not None
    assert read.free_turn.is_shown
    fallen = true @ np.diag([1.0, -1.0, -1.0, 1.0])
    assert found.laid(fallen) is found


@pytest.mark.parametrize("name", ["keyed", "pocketed"])
def test_a_turn_that_the_outline_or_a_lamp_shows_is_not_free(name: str) -> None:
    found = on_table(name, 2.1)
    assert found.free_turn is None
    assert (found.theta_rad - 2.1 + np.pi) % (2 * np.pi) - np.pi == pytest.approx(0.0, abs=0.03)


def test_a_round_part_has_no_turn_to_be_found() -> None:
    found = on_table("disc", 0.0)
    assert found.free_turn is None
    assert found.sigma_rad == pytest.approx(np.pi / np.sqrt(3))


# --- before the inspection camera -----------------------------------------------------------------

FREE = FreeTurn(AXIS, np.zeros(3), np.zeros(1))


def held(turn_deg: float) -> Array:
    """T_world_part of the shaft, upright before the camera, turned about its axis."""
    T = np.eye(4)
    T[:3, :3] = UPRIGHT @ FREE.by(np.radians(turn_deg))[:3, :3]
    T[:3, 3] = -T[:3, :3] @ solid("shaft").centroid_mm
    return T


def seen(turn_deg: float, body: Body | None = None) -> ViewPictures:
    return photograph(standing_shaft() if body is None else body, held(turn_deg), ())


@pytest.mark.parametrize("true_deg", [-75.0, -110.0])
def test_a_view_of_what_is_not_round_shows_the_turn(true_deg: float) -> None:
    """The camera is on the side of -y: there keyway and hole are at -90 degrees."""
    asked = replace(task(held(40.0), ()), facts=PartFacts(free_turn=FREE))
    found = locate_view(PosedPart(solid("shaft")), asked, seen(true_deg))
    assert not isinstance(found, NotEvaluated), found.reason
    off = found.fit.T_world_part[:3, :3].T @ held(true_deg)[:3, :3]
    assert np.degrees(rotation_angle(off)) < 1.0


def test_the_first_view_of_a_new_grasp_shows_how_far_round_jaws_let_a_part_turn() -> None:
    facts = PartFacts(free_turn=replace(FREE, is_shown=True))
    part, asked = PosedPart(solid("shaft")), replace(task(held(-75.0), ()), facts=facts)
    found = locate_view(part, asked, seen(-80.0))
    assert not isinstance(found, NotEvaluated), found.reason
    off = found.fit.T_world_part[:3, :3].T @ held(-80.0)[:3, :3]
    assert np.degrees(rotation_angle(off)) < 1.0
    # once the grasp is measured a view is at the turn that is known
    later = locate_view(part, replace(asked, is_hold_measured=True), seen(-75.0))
    assert not isinstance(later, NotEvaluated), later.reason
    off = later.fit.T_world_part[:3, :3].T @ held(-75.0)[:3, :3]
    assert np.degrees(rotation_angle(off)) < 0.5


def flanged() -> Body:
    """A disc with four through holes, of which a pocket on its front tells one."""
    body = rod(24, 14, 192).translate((0, 0, 7)) - box(7, 5, 6).translate((12, 12, 14))
    for x, y in ((17, 0), (0, 17), (-17, 0), (0, -17)):
        body -= rod(3, 40, 64).translate((x, y, 7))
    return body


@pytest.mark.parametrize("true_deg", [-17.0, 73.0, 162.0])
def test_holes_that_fit_at_a_wrong_turn_do_not_mislead_the_lamps(true_deg: float) -> None:
    """The outline at the guess is drawn to the nearest of four turns."""

    def shown_at(turn_deg: float) -> Array:
        T = np.eye(4)
        T[:3, :3] = (
            np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) @ (FREE.by(np.radians(turn_deg))[:3, :3])
        )
        T[:3, 3] = -T[:3, :3] @ np.array([0.0, 0, 7])
        return T

    asked = replace(task(shown_at(0.0), ()), facts=PartFacts(free_turn=FREE))
    part = PosedPart(solid_of(flanged(), "flanged"))
    found = locate_view(part, asked, photograph(flanged(), shown_at(true_deg), ()))
    assert not isinstance(found, NotEvaluated), found.reason
    off = found.fit.T_world_part[:3, :3].T @ shown_at(true_deg)[:3, :3]
    assert np.degrees(rotation_angle(off)) < 0.5


def round_shaft() -> Body:
    """The shaft as it looks from its round side: hole and keyway point away from the camera."""
    return rod(15, 26, 192).translate((0, 0, 13)) + rod(10, 34, 128).translate((0, 0, 43))


def test_a_view_of_the_round_side_proves_nothing_but_where_the_part_is() -> None:
    asked = replace(task(held(0.0), ()), facts=PartFacts(free_turn=FREE))
    part, body = PosedPart(solid("shaft")), round_shaft()
    found = locate_view(part, asked, seen(0.0, body))
    assert isinstance(found, NotEvaluated)
    assert found.T_world_part is not None
    np.testing.assert_allclose(found.T_world_part[:3, 3], held(0.0)[:3, 3], atol=0.3)
    result = inspect_view(part, sample_surface(part.solid), asked, seen(0.0, body), found)
    assert not result.evaluated
    assert not result.findings
    assert not result.compared.any()


def test_a_turn_that_an_earlier_view_shows_is_that_of_a_view_which_does_not() -> None:
    """Of one guess all views are expected: what two of them show together turns both."""
    part = PosedPart(solid("shaft"))
    asked = replace(task(held(40.0), ()), facts=PartFacts(free_turn=FREE))
    at_once = locate_view(part, asked, seen(-75.0))
    assert not isinstance(at_once, NotEvaluated)
    # the same part before the same camera, whose lamps have failed meanwhile
    dark = seen(-75.0)
    dark = ViewPictures(dark.backlit, {lamp: np.zeros_like(g) for lamp, g in dark.lit.items()})
    assert isinstance(locate_view(part, asked, dark), NotEvaluated)
    found = locate_view(part, asked, dark, [PicturedView(asked, seen(-75.0))])
    assert not isinstance(found, NotEvaluated), found.reason
    off = found.fit.T_world_part[:3, :3].T @ at_once.fit.T_world_part[:3, :3]
    assert np.degrees(rotation_angle(off)) < 5.0  # by its own pictures it may be anything near


def test_a_turn_shown_far_from_one_that_was_shown_is_another_guess() -> None:
    first = FREE.shown(2.0)  # of a guess any turn may be shown
    assert (first.is_shown, first.guess_number) == (True, 0)
    assert first.shown(np.radians(4.0)).guess_number == 0
    again = first.shown(np.radians(35.0))
    assert (again.is_shown, again.guess_number) == (True, 1)


def test_views_of_a_guess_that_was_wrong_are_turned_by_their_own_pictures() -> None:
    """A hold was taken to be shown 44 degrees off; the next grasp's view shows the turn."""
    part, wrong = PosedPart(solid("shaft")), replace(FREE, is_shown=True)
    views = [
        PicturedView(
            replace(task(held(deg), ()), view_id=name, facts=PartFacts(free_turn=free)),
            pictures,
            grasp=grasp,
        )
        for name, deg, free, pictures, grasp in (
            ("A", -31.0, wrong, seen(-75.0), 1),
            ("B", -31.0, wrong, seen(-75.0, round_shaft()), 2),
            ("C", -80.0, wrong.shown(0.8), seen(-80.0), 3),
        )
    ]
    found = pose_views(ViewSet(part, sample_surface(part.solid), tuple(views)), PoseSettings())
    for name, true_deg in (("A", -75.0), ("C", -80.0)):
        pose = found.pose(name)
        assert pose is not None
        off = pose.T_world_part_measured[:3, :3].T @ held(true_deg)[:3, :3]
        assert np.degrees(rotation_angle(off)) < 1.5
    alone = ViewSet(part, sample_surface(part.solid), (views[1], views[2]))
    open_one, known = pose_views(alone, PoseSettings()).outlined
    assert isinstance(open_one, OutlinedView)
    assert isinstance(known, OutlinedView)
    assert open_one.task.facts.is_turn_open
    assert not known.task.facts.is_turn_open
