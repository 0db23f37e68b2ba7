"""Marks in a face's texture: what texture makes is none, what is local on it is found."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from controller.imaging import Camera
from controller.inspection import InspectionLimits
from controller.inspection.lit.bounce import Bounced, Mirrored, Neighbours
from controller.inspection.lit.brightness import fit_brightness
from controller.inspection.lit.claims import shares_of_face
from controller.inspection.lit.compare import compare
from controller.inspection.lit.finish import HIGHLIGHT_WIDTHS_RAD, Polish, finish_of
from controller.inspection.lit.light import Light
from controller.inspection.lit.marks import (
    DIRECTIONS,
    DISC,
    SPOT_NODES,
    Answers,
    Tail,
    answers,
    smallest_nodes,
)
from controller.inspection.lit.spots import is_dust
from controller.inspection.lit.surface import Surface
from controller.inspection.lit.texture import Texture, borders, creases, find_texture

Array = NDArray[np.float32]
SHAPE = (120, 160)
RATE, WEAK = 0.01, 0.3
SPOT_RADII = tuple(DISC * sigma for sigma in SPOT_NODES)


def grid() -> tuple[Array, Array]:
    v, u = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]].astype(np.float32)
    return u, v


def plane() -> Surface:
    """A flat face that fills the window but for a border of four nodes."""
    seen = np.zeros(SHAPE, dtype=bool)
    seen[4:-4, 4:-4] = True
    count = int(seen.sum())
    ones = np.where(seen, 1.0, 0.0).astype(np.float32)
    u, v = grid()
    return Surface(
        seen=seen,
        points=np.column_stack([u[seen], v[seen], np.zeros(count)]) * 0.36,
        normals=np.tile([0.0, 0, 1], (count, 1)),
        facets=np.tile([0.0, 0, 1], (count, 1)),
        face=np.where(seen, 0, -1).astype(np.int32),
        cosine=ones,
        area_mm2=0.0324 * ones,
        depth_mm=600 * ones,
        node_mm=0.36 * ones,
    )


def texture_of(picture: Array, thrown: Array | None = None) -> Texture:
    surface, even = plane(), np.full(SHAPE, 100, np.float32)
    thrown = np.zeros(SHAPE, np.float32) if thrown is None else thrown
    return find_texture(picture, surface, surface.seen, even, thrown)


def judged(picture: Array) -> Answers:
    nothing = np.zeros(SHAPE, dtype=np.float32)
    return answers(texture_of(picture), nothing, nothing, RATE, WEAK)


def strength(picture: Array) -> Array:
    answer = judged(picture)
    return np.asarray((np.abs(answer.excess) / answer.limit).max(axis=0), np.float32)


def noisy(seed: int, share: float = 0.02) -> Array:
    """A face lit unevenly, with a fine texture."""
    u, v = grid()
    rng = np.random.default_rng(seed)
    light = 90 + 0.3 * u - 0.002 * (v - 60) ** 2
    return np.asarray(light * (1 + share * rng.normal(size=SHAPE)), np.float32)


def brushed(seed: int) -> Array:
    """Streaks along u, as of a milling cutter, a tenth of the brightness deep."""
    rng = np.random.default_rng(seed)
    lines = rng.normal(size=(SHAPE[0], 1)).astype(np.float32)
    return noisy(seed, 0.01) * (1 + 0.04 * lines)


# --- the limit follows from the tail -------------------------------------------------------------


@pytest.mark.parametrize(("power", "expected"), [(1.0, 0.01), (0.5, 0.01), (0.5, 1.0)])
def test_the_tail_reaches_as_far_as_the_law_it_was_drawn_from(
    power: float, expected: float
) -> None:
    # -log(uniform) is exponential, its root has a normal law's tail: both are known to the end
    rng = np.random.default_rng(3)
    heights = (-np.log(rng.uniform(size=4000))) ** power
    truth = float(np.log(4000 / expected)) ** power
    assert Tail(heights).height(expected) == pytest.approx(truth, rel=0.2)


def test_a_few_marks_do_not_move_the_tail() -> None:
    rng = np.random.default_rng(4)
    heights = (-np.log(rng.uniform(size=2000))) ** 0.5
    marked = np.concatenate([heights, np.full(20, 50.0)])
    assert Tail(marked).height(0.01) == pytest.approx(Tail(heights).height(0.01), rel=0.1)


# --- light from neighbours -----------------------------------------------------------------------


def bound_on_the_left(contrast: float) -> Array:
    """What neighbours may add beside a wall along the left side, as a contrast."""
    u, _ = grid()
    return np.where(u < 100, np.float32(contrast), np.float32(0))


def limit_under(picture: Array, bounced: Array) -> Array:
    answer = answers(texture_of(picture), np.zeros(SHAPE, np.float32), bounced, RATE, WEAK)
    return np.asarray(answer.limit[:, 60, 50], np.float32)


def test_light_that_neighbours_might_throw_and_do_not_hides_no_mark() -> None:
    free = limit_under(noisy(1), bound_on_the_left(0.0))
    held = limit_under(noisy(1), bound_on_the_left(2.0))
    assert (held <= 2.5 * free).all()


def test_light_that_neighbours_throw_in_many_places_keeps_its_bound() -> None:
    rng = np.random.default_rng(7)
    glints = noisy(1)
    for at in zip(rng.integers(8, 95, 40), rng.integers(8, 110, 40), strict=True):
        glints = disc(glints, at, 3.0, float(rng.uniform(-0.8, 0.8)))
    bound = bound_on_the_left(1.0)
    quiet, lively = (limit_under(one, bound) for one in (noisy(1), glints))
    assert (lively > 2 * quiet).all()


def test_one_mark_does_not_raise_its_own_limit() -> None:
    marked = disc(noisy(1), (50, 60), 4.0, -0.4)
    bound = bound_on_the_left(2.0)
    assert limit_under(marked, bound) == pytest.approx(limit_under(noisy(1), bound), rel=0.5)
    answer = answers(texture_of(marked), np.zeros(SHAPE, np.float32), bound, RATE, WEAK)
    assert (np.abs(answer.excess[:, 60, 50]) > answer.limit[:, 60, 50]).any()


def test_light_of_a_wall_that_the_prediction_has_is_no_mark() -> None:
    u, _ = grid()
    thrown = np.asarray(0.6 / (1 + ((u - 4) / 6.0) ** 2), np.float32)
    lit = noisy(2) * (1 + 0.7 * thrown)  # another albedo than the prediction's
    nothing = np.zeros(SHAPE, np.float32)
    known = answers(texture_of(lit, thrown), nothing, nothing, RATE, WEAK)
    unknown = answers(texture_of(lit), nothing, nothing, RATE, WEAK)
    highest = [float((np.abs(a.excess) / a.limit).max()) for a in (known, unknown)]
    assert highest[0] < 1.0 < highest[1]


# --- texture is no mark --------------------------------------------------------------------------


def test_noise_and_machining_marks_alone_are_no_marks() -> None:
    # one picture in a hundred may; forty of each kind are looked at
    alarms = sum(float(strength(noisy(s)).max()) >= 1 for s in range(40))
    alarms += sum(float(strength(brushed(s)).max()) >= 1 for s in range(40))
    assert alarms <= 3


def disc(picture: Array, at: tuple[int, int], radius: float, contrast: float) -> Array:
    u, v = grid()
    inside = np.clip(radius + 0.5 - np.hypot(u - at[0], v - at[1]), 0, 1)
    return np.asarray(picture * (1 + contrast * inside), np.float32)


def line(picture: Array, angle: float, length: float, width: float, contrast: float) -> Array:
    u, v = grid()
    x, y = u - 80, v - 60
    along, across = (
        x * np.cos(angle) + y * np.sin(angle),
        y * np.cos(angle) - x * np.sin(angle),
    )
    inside = np.clip(width / 2 + 0.5 - np.abs(across), 0, 1)
    inside *= np.clip(length / 2 + 0.5 - np.abs(along), 0, 1)
    return np.asarray(picture * (1 + contrast * inside), np.float32)


@pytest.mark.parametrize("radius", [2.5, 5.0, 9.0])
@pytest.mark.parametrize("make", [noisy, brushed])
def test_a_spot_a_fifth_darker_is_found_where_it_is(make: object, radius: float) -> None:
    assert callable(make)
    found = strength(disc(make(1), (100, 40), radius, -0.3))
    row, column = np.unravel_index(int(found.argmax()), SHAPE)
    assert found.max() > 1
    assert np.hypot(column - 100, row - 40) < radius + 3


@pytest.mark.parametrize("angle_deg", [0, 40, 90, 133])
def test_a_scratch_is_found_in_any_direction(angle_deg: float) -> None:
    picture = line(noisy(2), np.radians(angle_deg), 30, 1.5, -0.25)
    answer = judged(picture)
    ratio = np.abs(answer.excess) / answer.limit
    which, row, column = np.unravel_index(int(ratio.argmax()), ratio.shape)
    assert ratio.max() > 1
    assert which >= len(SPOT_NODES)
    off = (which - len(SPOT_NODES)) * 180 / DIRECTIONS - angle_deg
    assert abs((off + 90) % 180 - 90) <= 180 / DIRECTIONS
    assert np.hypot(column - 80, row - 60) < 16


def test_streaks_raise_the_limit_of_their_own_direction_only() -> None:
    calm, streaked = judged(noisy(5)), judged(brushed(5))
    middle = (slice(None), 60, 80)
    rise = streaked.limit[middle] / calm.limit[middle]
    lines = rise[len(SPOT_NODES) :]
    assert lines[0] > 1.3 * lines[DIRECTIONS // 2]


def test_what_would_be_found_is_smaller_on_a_calm_face() -> None:
    sizes = []
    for share in (0.02, 0.3):
        picture = noisy(6, share)
        widths = smallest_nodes(judged(picture), texture_of(picture), plane().cosine)["dent"]
        sizes.append(float(np.median(widths[plane().seen])))
    assert sizes[0] < sizes[1]


def strip(width: int) -> Surface:
    """A flat face only so many nodes high, in the middle of the window."""
    whole = plane()
    seen = np.zeros(SHAPE, dtype=bool)
    seen[60 - width // 2 : 60 - width // 2 + width, 4:-4] = True
    count = int(seen.sum())
    return replace(
        whole, seen=seen, points=np.zeros((count, 3)), normals=np.tile([0.0, 0, 1], (count, 1)),
        facets=np.tile([0.0, 0, 1], (count, 1)), face=np.where(seen, 0, -1).astype(np.int32),
    )  # fmt: skip


@pytest.mark.parametrize("width", [6, 10])
def test_what_is_claimed_of_a_narrow_face_is_found_there(width: int) -> None:
    surface = strip(width)
    nothing = np.zeros(SHAPE, dtype=np.float32)
    guide = np.full(SHAPE, 100, np.float32)
    found = claimed = 0
    for seed in range(12):
        at = (30 + 8 * seed, 60 - width // 2 + seed % width)
        before = find_texture(noisy(seed), surface, surface.seen, guide, nothing)
        answer = answers(before, nothing, nothing, RATE, WEAK)
        size = smallest_nodes(answer, before, surface.seen.astype(np.float32))["dent"][at[1], at[0]]
        if not np.isfinite(size):
            continue
        claimed += 1
        marked = disc(noisy(seed), at, size / 2, -0.3)
        after = answers(
            find_texture(marked, surface, surface.seen, guide, nothing),
            nothing,
            nothing,
            RATE,
            WEAK,
        )
        found += bool((np.abs(after.excess) > after.weak).any())
    assert claimed >= 6
    assert found >= 0.9 * claimed


def test_a_disc_cut_by_the_border_is_answered_as_much_as_is_claimed() -> None:
    inside = np.zeros(SHAPE, dtype=np.float32)
    inside[50:58] = 1.0
    whole = disc(np.ones(SHAPE, np.float32), (80, 54), SPOT_RADII[2], 1.0) - 1.0
    texture = Texture(
        inside.astype(np.int32), whole * inside, 100 * inside, 0 * inside, np.array([False, False])
    )
    nothing = np.zeros(SHAPE, dtype=np.float32)
    answer = answers(texture, nothing, nothing, RATE, WEAK)
    assert answer.gain[2][54, 80] == pytest.approx(answer.excess[2][54, 80], rel=0.02)


def test_a_round_mark_seen_aslant_is_claimed_larger_along_the_face() -> None:
    texture = texture_of(noisy(6))
    answer = judged(noisy(6))
    squarely, aslant = (
        smallest_nodes(answer, texture, np.full(SHAPE, c, np.float32))["dent"] for c in (1.0, 0.36)
    )
    both = np.isfinite(squarely) & np.isfinite(aslant)
    # as large in the picture as squarely: wider by one over the root of the cosine at the least
    assert both.any()
    assert (aslant[both] >= 1.66 * squarely[both]).all()


# straight above the plane, so that its nodes are those of the picture
ABOVE = Camera((1, 1), np.eye(3), np.zeros(5), np.diag([1.0, -1, -1, 1]))


def tilted(surface: Surface, normal: tuple[float, float, float]) -> Surface:
    """The same nodes, on a surface turned another way."""
    return replace(surface, normals=np.tile(normal, (len(surface.normals), 1)))


def test_a_defect_on_a_narrow_face_is_cut_by_the_face_itself() -> None:
    surface = plane()
    surface.face[50:56] = np.where(surface.seen[50:56], 1, -1)
    mask = surface.face == 1
    mask[50], mask[55] = False, False
    (share,) = shares_of_face([mask], surface, ABOVE, 8)
    # a disc of eight nodes about row 52 has on the rows 50 to 55 so much, and on 51 to 54 so much
    heights = np.arange(-2, 4)
    widths = 2 * np.floor(np.sqrt(16 - heights**2)) + 1
    assert share[52, 60] == pytest.approx(widths[1:-1].sum() / widths.sum(), abs=0.01)
    assert share[20, 20] == 0.0


def test_a_defect_on_a_surface_seen_aslant_is_narrower_in_the_picture() -> None:
    surface = plane()
    mask = np.zeros(SHAPE, dtype=bool)
    mask[58:63] = surface.seen[58:63]
    squarely, about_rows, about_columns = (
        shares_of_face([mask], tilted(surface, normal), ABOVE, 8)[0][60, 60]
        for normal in ((0.0, 0.0, 1.0), (0.0, 0.8, 0.6), (0.8, 0.0, 0.6))
    )
    # turned about a row it is 4.8 nodes high, and all of it lies on the five rows
    assert about_rows == pytest.approx(1.0)
    assert squarely < 0.8
    # turned about a column it is as high as before
    assert about_columns == pytest.approx(squarely, abs=0.1)


def test_a_bright_corner_is_judged_with_its_doubt() -> None:
    picture = disc(noisy(7), (100, 40), 4, 0.3)
    nothing = np.zeros(SHAPE, dtype=np.float32)
    u, v = grid()
    # too small a corner to show how far its light stays below the bound
    doubt = np.where(np.hypot(u - 100, v - 40) < 5, np.float32(0.5), np.float32(0))
    for bounced, is_found in ((nothing, True), (doubt, False)):
        answer = answers(texture_of(picture), nothing, bounced, RATE, WEAK)
        assert bool((np.abs(answer.excess) > answer.limit).any()) is is_found


def test_an_edge_is_where_faces_meet_and_where_one_stands_before_another() -> None:
    surface = plane()
    surface.face[:, 80:] = np.where(surface.seen[:, 80:], 1, -1)
    edge = borders(surface.face, surface.depth_mm, surface.node_mm)
    assert edge[60, 79]
    assert edge[60, 80]
    assert not edge[60, 60]
    surface = plane()
    surface.depth_mm[:, 50:] += 5.0
    assert borders(surface.face, surface.depth_mm, surface.node_mm)[60, 49:51].all()


def test_an_edge_is_where_a_face_turns_sharply() -> None:
    surface = plane()
    bent = np.where(grid()[0] < 50, 0.0, np.radians(12.0))[surface.seen]
    turned = replace(surface, normals=np.column_stack([np.sin(bent), 0 * bent, np.cos(bent)]))
    assert not creases(surface).any()
    assert creases(turned)[60, 49:51].all()
    assert not creases(turned)[60, [48, 51]].any()


# --- the light fitted to a picture ---------------------------------------------------------------


def light_on(matt: Array, glint: Array) -> Light:
    zero = np.zeros(SHAPE, dtype=np.float32)
    glints = [(zero, zero) for _ in HIGHLIGHT_WIDTHS_RAD]
    glints[1] = (glint, glint)
    nowhere = np.zeros(SHAPE, dtype=bool)
    alone = Neighbours(nowhere, np.zeros(SHAPE, np.int32), np.zeros((0, 3)), (), ())
    dark = np.zeros((len(HIGHLIGHT_WIDTHS_RAD), 0))
    none = Bounced(zero, zero, Mirrored(dark, dark, dark[0], dark, dark, dark), alone)
    return Light(matt, matt, matt, none, tuple(glints), nowhere, nowhere)


def test_a_picture_that_is_black_where_a_lamp_would_light_it_has_no_light_of_that_lamp() -> None:
    u, _ = grid()
    matt = (0.5 + 0.4 * u / SHAPE[1]).astype(np.float32)
    black = np.zeros(SHAPE, dtype=np.float32)
    black[50:60, 70:80] = 90.0  # something else shines there
    light = light_on(matt, np.zeros(SHAPE, dtype=np.float32))
    everywhere = np.ones(SHAPE, dtype=bool)
    found = fit_brightness(black, light, everywhere, np.zeros(SHAPE, dtype=np.int32))
    assert np.isfinite(found.predicted).all()
    assert np.median(found.predicted) < 1.0


def test_the_shares_of_a_picture_are_found_and_what_none_explains_is_its_error() -> None:
    u, v = grid()
    matt = (0.5 + 0.4 * u / SHAPE[1]).astype(np.float32)
    glint = np.exp(-(((u - 80) / 25) ** 2) - ((v - 60) / 25) ** 2).astype(np.float32)
    rng = np.random.default_rng(8)
    picture = (150 * matt + 60 * glint) * (1 + 0.03 * rng.normal(size=SHAPE))
    seen = plane().seen
    face = np.where(seen, 0, -1).astype(np.int32)
    got = fit_brightness(picture.astype(np.float32), light_on(matt, glint), seen, face)
    truth = 150 * matt + 60 * glint
    assert np.abs(got.predicted * got.tone / truth - 1)[seen].max() < 0.04
    assert np.median(got.spread[seen]) == pytest.approx(0.03, rel=0.5)
    assert got.typical == pytest.approx(0.6745 * 0.03, rel=0.15)


def test_light_that_no_fitted_node_shows_is_not_known() -> None:
    # the highlight lies where nothing was fitted: how strong it is stays open
    u, v = grid()
    matt = (0.5 + 0.4 * u / SHAPE[1]).astype(np.float32)
    glint = np.exp(-(((u - 130) / 8) ** 2) - ((v - 60) / 8) ** 2).astype(np.float32)
    seen = plane().seen
    fitting = seen & (u < 90)
    face = np.where(seen, 0, -1).astype(np.int32)
    picture = (150 * matt).astype(np.float32)
    got = fit_brightness(picture, light_on(matt, glint), fitting, face)
    assert got.spread[60, 130] > 0.3
    assert got.spread[60, 60] < 0.05


def compared_beside(thrown: Array) -> NDArray[np.bool_]:
    """Where a polished plane is compared, beside neighbours that may throw so much on it."""
    u, _ = grid()
    surface, matt = plane(), (0.5 + 0.4 * u / SHAPE[1]).astype(np.float32)
    zero, coarse = np.zeros(SHAPE, np.float32), surface.seen[::4, ::4]
    about = Neighbours(coarse, surface.face, np.zeros((int(coarse.sum()), 3)), (), ())
    dark = np.zeros((len(HIGHLIGHT_WIDTHS_RAD), int(coarse.sum())))
    lobes = dark.copy()
    lobes[-1] = thrown[::4, ::4][coarse]
    light = replace(
        light_on(matt, zero),
        bounced=Bounced(zero, zero, Mirrored(lobes, dark, dark[0], dark, dark, dark), about),
    )
    picture = 120 * matt
    brightness = fit_brightness(picture, light, surface.seen, surface.face)
    finish = finish_of([Polish(np.array([0.0, 0.0, 0.0, 1.0]), 1e4 * np.eye(4))])
    mirrored, _ = light.bounced.most_mirrored(finish)
    limits = InspectionLimits()
    found = compare(picture, surface, light, brightness, mirrored, surface.seen, 20.0, limits, 0.3)
    assert not found.wrong.any()
    return found.compared


def test_light_that_a_face_has_alike_from_neighbours_is_in_its_tone() -> None:
    u, _ = grid()
    seen = plane().seen
    assert compared_beside(np.full(SHAPE, 2.0, np.float32))[seen].mean() > 0.9
    corner = compared_beside(np.where(u > 120, np.float32(2.0), np.float32(0.0)))
    assert not corner[:, 128:].any()
    assert corner[seen & (u < 110)].mean() > 0.9


@pytest.mark.parametrize(("size_mm", "expected"), [(0.3, True), (1.2, False)])
def test_a_speck_of_dust_is_no_larger_beside_a_dark_background(
    size_mm: float, expected: bool
) -> None:
    mm, step_px, border, at = 0.18, 2, 24, (20.0, 30.0)
    v, u = np.mgrid[0:48, 0:64].astype(np.float64)
    speck = np.clip(0.5 * size_mm / mm + 0.5 - np.hypot(v - at[0], u - at[1]), 0.0, 1.0)
    picture = np.where(v < border, 200.0 * (1.0 - 0.5 * speck), 15.0)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7)
    nodes = np.where(np.arange(24) * step_px < border, 0, -1)  # to the border, blur and all
    face = np.repeat(nodes[:, None], 32, axis=1).astype(np.int32)
    surface = replace(plane(), face=face, node_mm=np.full(face.shape, step_px * mm, np.float32))
    peak = int(at[0]) // step_px, int(at[1]) // step_px
    grey = np.round(picture).astype(np.uint8)
    assert is_dust(grey, (0, 0), peak, step_px, 0.5, surface, 2.0 * size_mm) == expected
