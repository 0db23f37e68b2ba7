"""Parts under lamps that touch or lie on others: named, placed, and said to lie on what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, rod, solid_of
from lit_pictures import Renderer, Scene, placed
from numpy.typing import NDArray
from table_pictures import overhead, resting

from controller.cad import Solid, stable_poses
from controller.cad.compiled import compile_solid
from controller.imaging import PointLamp
from controller.recognition import Library, Sighting, make_library, recognise
from controller.recognition.fitting import EdgeFit, Gaps, edge_model, predict_edges
from controller.recognition.identification.clusters import Answers, each_once
from controller.recognition.identification.decide import Decision
from controller.recognition.identification.hypotheses import Hypothesis
from controller.recognition.identification.lit.choice import ClusterPlace, chosen
from controller.recognition.identification.lit.fits import LitCluster, LitFit
from controller.recognition.identification.lit.parts import (
    held,
    is_detail,
    outlines_of,
    sure_beside_unknown,
)
from controller.recognition.identification.lit.search import ClusterSearch, tipped
from controller.recognition.identification.scene import TableScene
from controller.recognition.library import Candidate
from controller.recognition.segmentation import Region, joined, near_ones

Array = NDArray[np.float64]
CAMERA = overhead()
TABLE = np.array([[-150.0, -120, 0], [150, -120, 0], [150, 120, 0], [-150, 120, 0]])
RING = PointLamp.ring("ring", np.array([0.0, 0, 690]), np.array([0.0, 0, -1]), 150.0)
BODIES: dict[str, Body] = {
    "plate": box(60, 40, 10) - rod(6, 40, 48).translate((18, 8, 0)),
    "bar": (
        box(70, 16, 8)
        - rod(5, 40, 48).translate((-27, 0, 0))
        - box(10, 6, 40).translate((28, 1, 0))
        - box(3, 9, 40).translate((34, -4, 0))
    ),
    "rod": rod(5, 40, 48),
    "ring": rod(20, 10, 96) - rod(15, 40, 96),
    "strange": box(38, 30, 10) - box(14, 10, 20).translate((10, 8, 0)),
}
LYING = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # what stood along z lies along x


@cache
def solid(name: str) -> Solid:
    return solid_of(BODIES[name], name)


@cache
def library() -> Library:
    return make_library([compile_solid(solid(name)) for name in ("plate", "bar")], CAMERA)


def flat(name: str, x: float, y: float, theta: float = 0.0) -> Array:
    return resting(solid(name), stable_poses(solid(name))[0].R, x, y, theta)


def leaning(name: str, x: float, on_x_mm: float, on_mm: float) -> Array:
    """A body whose left lower edge is on the table, and which rests on an edge right of it.

    The edge runs along y at ``on_x_mm`` in a height of ``on_mm``; the body's middle is about x.
    """
    level = flat(name, x, 0.0)
    low = float((trimesh.transform_points(solid(name).mesh.vertices, level))[:, 0].min())
    tilt = np.arctan2(on_mm, on_x_mm - low)
    turn = trimesh.transformations.rotation_matrix(-tilt, (0.0, 1.0, 0.0), (low, 0.0, 0.0))
    return np.asarray(turn @ level)


def look(*bodies: tuple[str, Array], seed: int = 0) -> tuple[Sighting, ...]:
    scene = trimesh.util.concatenate([placed(solid(name).mesh, T) for name, T in bodies])
    image = Renderer(Scene(scene, None, TABLE), CAMERA, seed=seed).lit(RING)
    return recognise(image, CAMERA, library(), "front").sightings


def assert_placed(seen: Sighting, name: str, T: Array, within_mm: float = 0.3) -> None:
    assert seen.part == name
    assert seen.T_world_part is not None
    centre = np.append(solid(name).centroid_mm, 1.0)
    off = (seen.T_world_part @ centre - T @ centre)[:2]
    assert np.linalg.norm(off) < within_mm


def test_two_parts_that_touch_under_lamps_are_both_named_and_lie_on_nothing() -> None:
    T_plate, T_bar = flat("plate", -20.0, 5.0), flat("bar", 18.05, 0.0, np.pi / 2)
    first, second = look(("plate", T_plate), ("bar", T_bar))
    plate, bar = (first, second) if first.part == "plate" else (second, first)
    assert_placed(plate, "plate", T_plate)
    assert_placed(bar, "bar", T_bar)
    for one in (plate, bar):
        assert (one.lies_on, one.is_covered, one.touching_count) == ((), False, 1)
    # 40 of the plate's 200 mm are against the bar
    assert plate.free_share == pytest.approx(1 - 40 / (200 + 12 * np.pi), abs=0.06)


def test_an_edge_that_one_lamp_shows_is_an_edge_of_the_cluster_but_needs_no_explanation() -> None:
    plain = np.full((60, 80), 90, np.uint8)
    stepped = plain.copy()
    stepped[:, 40:] = 30  # a shadow there, or a step: it is darker, so that the brightest is plain
    mask = np.ones(plain.shape, np.bool_)
    cluster = LitCluster([plain, plain, stepped], (0, 0, 80, 60), mask, CAMERA)
    assert np.abs(cluster.grey.gx[30]).argmax() in (39, 40)
    assert len(cluster.image_edges.points_px) == 0
    assert [one.min() for one in cluster.telling] == [90, 30]


def test_a_part_that_leans_on_another_is_named_with_its_tilt_and_what_it_lies_on() -> None:
    T_bar = flat("bar", 15.0, 0.0, np.pi / 2)
    T_plate = leaning("plate", -11.0, 7.0, 8.0)
    seen = look(("bar", T_bar), ("plate", T_plate))
    numbers = {one.part: k for k, one in enumerate(seen)}
    plate, bar = seen[numbers["plate"]], seen[numbers["bar"]]
    assert_placed(plate, "plate", T_plate)
    assert plate.lies_on == (numbers["bar"],)
    assert not plate.is_covered
    assert plate.T_world_part is not None
    tilt = np.degrees(np.arccos((plate.T_world_part[:3, :3] @ T_plate[:3, :3].T)[2, 2]))
    assert tilt < 1.0
    assert_placed(bar, "bar", T_bar)
    assert (bar.lies_on, bar.is_covered) == ((), True)


def test_before_a_light_table_a_lamp_tells_what_leans_on_a_part() -> None:
    on_side = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # 16 mm high, 8 mm wide
    T_bar = resting(solid("bar"), on_side, 15.0, 0.0, np.pi / 2)
    T_plate = leaning("plate", -11.0, 11.0, 16.0)  # by 17 degrees
    scene = trimesh.util.concatenate(
        [placed(solid(name).mesh, T) for name, T in (("bar", T_bar), ("plate", T_plate))]
    )
    renderer = Renderer(Scene(scene, None, TABLE), CAMERA)
    panel, ring = renderer.backlit(), renderer.lit(RING)

    by_panel = recognise(panel, CAMERA, library(), "backlit").sightings
    assert sorted(str(one.part) for one in by_panel) == ["None", "bar"]

    seen = recognise(panel, CAMERA, library(), "backlit", lit=[ring]).sightings
    numbers = {one.part: k for k, one in enumerate(seen)}
    plate, bar = seen[numbers["plate"]], seen[numbers["bar"]]
    assert_placed(plate, "plate", T_plate)
    assert_placed(bar, "bar", T_bar)
    assert (plate.lies_on, plate.is_covered) == ((numbers["bar"],), False)
    assert (bar.lies_on, bar.is_covered) == ((), True)


def test_a_pose_is_tipped_where_the_camera_sees_it_with_its_lowest_point_on_the_table() -> None:
    T_flat, tilt = flat("plate", -60.0, 30.0), np.radians(10.0)
    model = edge_model(solid("plate"))
    T = tipped(model, T_flat, np.array([1.0, 0.0]), tilt, CAMERA)
    corners = np.array([[x, y, z] for x in (-30.0, 30) for y in (-20.0, 20) for z in (-5.0, 5)])
    before, after = (trimesh.transform_points(corners, one) for one in (T_flat, T))
    assert after[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert np.ptp(after[:, 2]) == pytest.approx(60 * np.sin(tilt) + 10 * np.cos(tilt), abs=1e-6)
    assert after[after[:, 0].argmax(), 2] > after[after[:, 0].argmin(), 2]
    seen = [CAMERA.project(points.mean(axis=0)[None])[0] for points in (before, after)]
    assert seen[0] == pytest.approx(seen[1], abs=1.0)


def test_what_touches_a_known_part_under_lamps_and_is_none_stays_unknown() -> None:
    T_plate, T_strange = flat("plate", -20.0, 0.0), flat("strange", 29.1, 0.0)
    seen = look(("plate", T_plate), ("strange", T_strange))
    assert sorted(str(one.part) for one in seen) == ["None", "plate"]
    plate = next(one for one in seen if one.part == "plate")
    assert_placed(plate, "plate", T_plate)
    other = next(one for one in seen if one.part is None)
    assert "touches known parts" in other.reason


def test_a_stranger_by_itself_under_lamps_is_not_made_of_known_parts() -> None:
    (seen,) = look(("strange", flat("strange", 10.0, -12.0, 0.7)))
    assert (seen.part, seen.lies_on, seen.is_covered) == (None, (), False)


def reading(part: int, probability: float, x_mm: float = 0.0) -> Hypothesis:
    """What is known of a reading but how sure it is, and of what where, does not matter here."""
    found = {"part": part, "pose": part, "probability": probability}
    found["place_mm"] = np.array([x_mm, 0.0])
    same = {"log_odds": 10.0, "evidence": SimpleNamespace(area_mm2=1.0)}
    return cast(Hypothesis, SimpleNamespace(**found, **same))


def place(*readings: Hypothesis) -> ClusterPlace:
    decision = Decision(readings[0], readings[0].probability / len(readings), readings[1:], None)
    return ClusterPlace(cast(LitFit, None), (), decision, readings)


def with_rare(*numbers: int) -> Library:
    """A library of three parts; those of these numbers hardly ever come to lie so."""
    poses = [SimpleNamespace(drop_probability=0.001 if k in numbers else 0.3) for k in range(3)]
    entry = SimpleNamespace(pose=lambda index: poses[index])
    return cast(Library, SimpleNamespace(entries=[entry] * 3))


def test_beside_something_unknown_only_what_is_sure_by_itself_is_named() -> None:
    sure, detail, none = place(reading(0, 0.95)), place(reading(1, 0.74)), with_rare()
    assert sure_beside_unknown([sure, detail], none, is_unknown_left=True) == ([sure], [detail])
    assert sure_beside_unknown([sure, detail], none, is_unknown_left=False) == ([sure, detail], [])


def test_what_stands_on_its_rim_in_a_cluster_is_sure_and_beside_nothing_unknown() -> None:
    sure, unsure, flat_one = (
        place(reading(0, 0.99)),
        place(reading(1, 0.74)),
        place(reading(2, 0.7)),
    )
    rims = with_rare(0, 1)
    every = [sure, unsure, flat_one]
    assert sure_beside_unknown(every, rims, is_unknown_left=False) == ([sure, flat_one], [unsure])
    assert sure_beside_unknown([sure], rims, is_unknown_left=True) == ([], [sure])


def test_a_piece_of_a_part_is_not_named_as_that_part_once_more() -> None:
    def answer(part: str | None, x_mm: float, score: float = 0.9) -> Answers:
        seen = SimpleNamespace(part=part, x_mm=x_mm, y_mm=0.0, score=score)
        return cast(Answers, (None, [(seen, None)]))

    part, piece, again, other = (
        answer("a", *at) for at in ((0, 0.99), (1.5, 0.98), (1, 0.99), (40,))
    )
    unknown, another = answer(None, 0.0), answer("b", 0.5)
    every = [piece, part, unknown, again, other, another]
    assert each_once(every) == [part, unknown, other, another]


def test_a_part_is_sure_whose_turn_is_open_and_not_one_whose_place_or_name_is() -> None:
    turned = place(reading(0, 0.95), reading(0, 0.94, 0.2), reading(0, 0.93, -0.2))
    elsewhere = place(reading(0, 0.95), reading(0, 0.94, 9.0))
    another = place(reading(0, 0.95), reading(1, 0.94))
    named, unsure = sure_beside_unknown(
        [turned, elsewhere, another], with_rare(), is_unknown_left=True
    )
    assert named == [turned]
    assert unsure == [elsewhere, another]


def fitted(name: str, T: Array, missing: Callable[[Array], NDArray[np.bool_]]) -> LitFit:
    """A body fitted where it is, all of its edges found but for some points (n, 3) of its own."""
    model = edge_model(solid(name))
    edges = predict_edges(model, T, CAMERA, 1000)
    own = trimesh.transform_points(edges.points_mm, np.linalg.inv(T))
    gap_px = np.where(missing(own), np.nan, 0.0)
    fit = EdgeFit(T, edges, Gaps(gap_px, np.ones(len(gap_px))), 0.1, np.zeros((3, 3)))
    width, height = CAMERA.size_px
    return LitFit(cast(Candidate, None), model, fit, whole(np.zeros((height, width), np.uint8)))


def whole(picture: NDArray[np.uint8]) -> LitCluster:
    """All of a picture as one cluster."""
    height, width = picture.shape
    return LitCluster([picture], (0, 0, width, height), np.ones(picture.shape, np.bool_), CAMERA)


def test_what_looks_like_a_part_has_its_outline_in_its_place_and_another_has_not() -> None:
    T = flat("plate", 12.0, -7.0, 0.3)
    fit = fitted("plate", T, none)
    shadow = fit.shadow.astype(np.uint8)
    loops, _ = cv2.findContours(shadow, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    width, height = CAMERA.size_px
    outlines = tuple(loop.reshape(-1, 2).astype(np.float64) for loop in loops)
    whole = (0, 0, width, height)
    seen = Region(whole, fit.shadow, outlines, False, float(fit.shadow.sum()), ())
    dark = np.zeros((height, width), np.uint8)
    search = ClusterSearch(seen, TableScene([dark], CAMERA, library(), is_backlit=False))
    found = search.like(seen)
    assert {library().entries[one.part].name for one in found} == {"plate"}
    centre = T @ np.append(solid("plate").centroid_mm, 1.0)
    assert np.linalg.norm(found[0].place_mm - centre[:2]) < 1.0


def none(own: Array) -> NDArray[np.bool_]:
    return np.zeros(len(own), np.bool_)


def has_ends(fit: LitFit) -> bool:
    return fit.has_ends(fit.seen_fit(()))


def test_a_rod_is_told_from_a_longer_one_by_both_of_its_ends() -> None:
    lying = resting(solid("rod"), LYING, 10.0, 5.0, 0.4)
    assert has_ends(fitted("rod", lying, none))
    assert not has_ends(fitted("rod", lying, lambda own: own[:, 2] > 19.5))
    # its sides, where a streak may hide a dark limb, are not what tells it
    assert has_ends(fitted("rod", lying, lambda own: np.abs(own[:, 2]) < 15.0))


def piece(*, left_of_px: float | None = None, outside: LitFit | None = None) -> NDArray[np.bool_]:
    """An unknown piece: what is left of a column, or all round a part."""
    width, height = CAMERA.size_px
    if outside is not None:
        return ~outside.shadow
    return np.tile(np.arange(width) < left_of_px, (height, 1))


def test_what_something_unknown_surrounds_is_a_detail_of_it() -> None:
    plate = fitted("plate", flat("plate", 0.0, 0.0), none)
    assert not is_detail(plate, (), ())
    assert is_detail(plate, (), [piece(outside=plate)])
    # 40 of its 200 mm are against what lies left of it
    beside = piece(left_of_px=float(plate.fit.edges.pixels[:, 0].min()))
    assert not is_detail(plate, (), [beside])


def test_a_part_whose_outline_gives_way_to_something_unknown_is_a_detail_of_it() -> None:
    plate = fitted("plate", flat("plate", 0.0, 0.0), lambda own: own[:, 0] < -29.5)
    beside = piece(left_of_px=float(plate.fit.edges.pixels[:, 0].min()) + 3)
    assert is_detail(plate, (), [beside])


def test_what_has_been_given_up_is_unknown_to_what_borders_on_it() -> None:
    plate = fitted("plate", flat("plate", 0.0, 0.0), none)
    assert is_detail(plate, (), (), [piece(outside=plate)])
    # more than a third of its outline, as of a strip that is the edge of something
    x_px = plate.fit.edges.pixels[:, 0]
    around = ~plate.shadow & piece(left_of_px=float(x_px.mean()))
    assert is_detail(plate, (), [around])


def test_what_is_seen_through_a_part_is_not_what_it_is_a_detail_of() -> None:
    ring = fitted("ring", flat("ring", 4.0, 9.0), none)
    rim, _ = cv2.findContours(ring.shadow.astype(np.uint8), cv2.RETR_EXTERNAL, 1)
    within = cv2.drawContours(np.zeros(ring.shadow.shape, np.uint8), rim, -1, 1, cv2.FILLED) > 0
    bore = within & ~ring.shadow
    seen = ring.fit.edges.on_outline
    assert np.mean(~ring.is_outside(ring.fit.edges.pixels + 6 * ring.fit.edges.normals)[seen]) > 0.4
    assert not is_detail(ring, (), [bore])
    assert is_detail(ring, (), [~within])


def test_where_a_part_would_lean_on_nothing_what_explains_it_next_best_is_taken() -> None:
    T = flat("plate", 12.0, -7.0, 0.3)
    level = fitted("plate", T, none)
    cluster = whole(np.where(level.shadow, 150, 20).astype(np.uint8))
    level = replace(level, cluster=cluster)
    tilted = replace(level, fit=replace(level.fit, T_world_part=T.copy()), leans=True)

    def hypothesis(fit: LitFit, others: object, area: object) -> Hypothesis:
        lead = 50.0 if fit.leans else 0.0
        centre = np.array([12.0, -7.0])
        evidence = fit.evidence(())
        return Hypothesis(0, 0, 0.0, centre, fit.fit, evidence, 0.95, lead, 1.0, "cluster")

    stub = SimpleNamespace(
        cluster=cluster,
        alone=lambda fit: 0.95,
        worth=lambda fit: 2.0 if fit.leans else 1.0,
        hypothesis=hypothesis,
    )
    search = cast(ClusterSearch, stub)
    places = chosen([level, tilted], search, library())
    assert [one.fit for one in places] == [tilted]
    fits, places = held([level, tilted], places, search, library())
    assert list(fits) == [level]
    assert [one.fit for one in places] == [level]


def patch(x: int, y: int, width: int, height: int) -> Region:
    mask = np.zeros((height + 8, width + 8), dtype=np.bool_)
    mask[4:-4, 4:-4] = True
    box_px = (x - 4, y - 4, x + width + 4, y + height + 4)
    return Region(box_px, mask, (), False, float(width * height), ())


def test_things_a_shaded_side_apart_are_one_group_and_others_are_not() -> None:
    first, beside, far = patch(100, 100, 50, 40), patch(158, 110, 30, 30), patch(300, 100, 20, 20)
    assert near_ones([first, far, beside]) == [[0, 2], [1]]
    # boxes overlap, masks do not come near each other
    corner = patch(160, 152, 30, 30)
    assert near_ones([first, corner]) == [[0], [1]]


def test_joined_things_keep_their_masks_where_they_were() -> None:
    first, beside = patch(100, 100, 50, 40), patch(158, 110, 30, 30)
    together = joined([first, beside])
    assert together.box_px == (96, 96, 192, 144)
    assert together.mask.sum() == first.mask.sum() + beside.mask.sum()
    assert together.mask[110 + 10 - 96, 160 + 10 - 96]
    assert together.area_px == first.area_px + beside.area_px


def test_joined_things_keep_the_silhouettes_that_each_of_them_may_have() -> None:
    first, beside = patch(100, 100, 50, 40), patch(158, 110, 30, 30)
    bright = np.zeros_like(first.mask)
    bright[10:20, 10:30] = True
    together = joined([replace(first, alternatives=(bright,)), beside])
    (other,) = together.alternatives
    assert other.sum() == bright.sum() + beside.mask.sum()
    assert other[110 - 100, 110 - 96]
    assert not other[105 - 100, 110 - 96]
    assert [int(one.area_px) for one in outlines_of(together, 50.0)] == [2000, 900, 200]


def test_a_cluster_has_the_outlines_of_all_its_silhouettes_each_piece_once() -> None:
    # one thing, of which the bright silhouette shows two parts, and a speck
    dark = patch(100, 100, 60, 40)
    bright = np.zeros_like(dark.mask)
    bright[10:40, 8:28], bright[10:40, 34:60], bright[6, 6] = True, True, True
    pieces = outlines_of(replace(dark, alternatives=(bright, dark.mask.copy())), 50.0)
    assert sorted(int(one.area_px) for one in pieces) == [600, 780, 2400]
    assert all(len(one.loops_px) == 1 for one in pieces)
    left, top = pieces[1].loops_px[0].min(axis=0)
    assert (left, top) in {(96 + 8, 96 + 10), (96 + 34, 96 + 10)}
