"""Fit of features in one picture: two looks along rays across predicted edges, and self-checks.

The first look has a wide reach and uses some of the rays, since a dimension may be wrong by many
pixels. The second uses all rays, placed anew where the first found the edge, so that each crosses
the edge squarely at its middle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Final

import numpy as np
from scipy.special import expit

from controller.arrays import BoolArray, FloatArray, Grey, IndexArray, median
from controller.imaging import (
    EdgeFits,
    blur_shift_px,
    measure_edges,
    measure_sloped_edges,
    transform,
)
from controller.imaging.levels import pixel_noise
from messages import key, say

from .._pose import PosedPart
from .._scene import ViewScene, make_scene
from ._checks import SURE_PX, PictureKind, Sharpness, failure_of, form_of, lean_px, sharpness_of
from ._features import Feature, FeatureFit
from ._foreseen import is_explained, shadow_shifts_px
from ._rays import Rays, place_rays, with_outline, with_rotation, with_visibility
from ._rivals import rival_px
from ._types import BACKLIT, MeasuringSettings, PosedView
from .solving import Solution, solve

# Reach of the first look; before a panel no other edge can be mistaken for the sought one.
FAR_PX: Final = {True: 16.0, False: 6.0}
# Largest reach as a share of a radius; beyond it lies the opposite side of the circle.
FAR_SHARE: Final = 0.6
NEAR_PX: Final = 2.5
SLACK_PX: Final = 1.0  # reach added to the second look for the error of the first
LEAN_KNOWN: Final = 0.3  # standard uncertainty of a lean, as a share of it
FEW: Final = 32  # number of rays in the first look
EITHER: Final = 1 / 3**0.5  # standard deviation of a rectangular distribution of half width 1
RECTANGLE: Final = 1 / 12**0.5  # standard deviation of a rectangular distribution of width 1
# Standard uncertainty of the border of light beside a CAD edge, as a share of its distance.
OUTLINE_KNOWN: Final = 0.5
BLUR_KNOWN: Final = 0.1  # difference between a lens's blur and a Gaussian one, as a share
# Uncertainty as a share of a chord's height, since blur rounds the corners between chords.
CHORDS_KNOWN: Final = 0.1
ANOTHER: Final = key("another edge of the part, or a shadow's border, belongs where it was found")
# Reasons where no edge of a recess is in sight at its mouth, and at its floor.
NOT_IN_SIGHT: Final = (
    key("no edge of its mouth is in sight"),
    key("no edge of its floor is in sight"),
)


@dataclass(frozen=True, eq=False, slots=True)
class Prediction:
    """Predicted edges of features in a view.

    Attributes
    ----------
    view, scene : the view, and its scene without the part
    features : features, in order
    rays : rays across all their edges
    feature, curve : (n,) number of each ray's feature, and of the edge in it, from 0
    curve_counts : number of edges of each feature
    pixel_mm : pixel size at the part
    pivot_mm : (3,) world, centre of the uncertain rotation
    """

    view: PosedView
    scene: ViewScene
    features: tuple[Feature, ...]
    rays: Rays
    feature: IndexArray
    curve: IndexArray
    curve_counts: tuple[int, ...]
    pixel_mm: float
    pivot_mm: FloatArray


def predict(part: PosedPart, view: PosedView, features: Sequence[Feature]) -> Prediction:
    """Return the predicted edges of one or more features in a view.

    Parameters
    ----------
    part : the part
    view : the view, with its pose
    features : features of the part
    """
    camera, T = view.task.camera, view.T_world_part_measured
    pivot = transform(T, part.solid.centroid_mm[None])[0]
    pixel_mm = camera.mm_per_px(pivot)
    curves, feature, curve, counts = [], [], [], []
    for i, one in enumerate(features):
        edges = one.curves(part.solid, pixel_mm, np.zeros(one.unknown_count))
        for j, edge in enumerate(edges):
            feature.append(np.full(len(edge.points_mm), i, dtype=np.intp))
            curve.append(np.full(len(edge.points_mm), j, dtype=np.intp))
        curves += edges
        counts.append(len(edges))
    scene = view.scene if view.scene is not None else make_scene(view.task)
    rays = with_visibility(place_rays(curves, T, camera), curves, part, T, camera, scene)
    return Prediction(
        view,
        scene,
        tuple(features),
        with_outline(rays, part, T, camera),
        np.concatenate(feature),
        np.concatenate(curve),
        tuple(counts),
        pixel_mm,
        pivot,
    )


def fit_features(
    part: PosedPart,
    prediction: Prediction,
    lamp: str,
    sharpness: Sharpness | None,
    settings: MeasuringSettings,
) -> tuple[list[FeatureFit], Sharpness | None]:
    """Return the fit of each feature in one picture, and the sharpness of its edges.

    Parameters
    ----------
    part : the part
    prediction : predicted edges
    lamp : lamp of the picture, or `BACKLIT`
    sharpness : sharpness of the view's backlit picture; None for that picture itself
    settings : limits of a valid measurement
    """
    view, rays = prediction.view, prediction.rays
    is_backlit = lamp == BACKLIT
    picture = view.picture(lamp)
    noise = pixel_noise(picture, None, 1)
    shows = (rays.rising != 0) & np.isfinite(rays.outline_px) if is_backlit else rays.shows_lit
    index = np.flatnonzero(shows)
    owner = prediction.feature[index]
    counts = np.bincount(owner, minlength=len(prediction.features))
    rising = rays.rising[index] if is_backlit else None
    chosen = rays.chosen(index)
    moved = _first_look(prediction, picture, index, rising, noise, counts)
    again = _placed_again(part, prediction, moved, index)
    found = measure_edges(picture, again.pixels, again.normals, NEAR_PX, noise, rising)
    again = replace(
        with_rotation(again, view.T_world_part_measured, prediction.pivot_mm),
        rising=chosen.rising,
        wall_px=chosen.wall_px,
        # Under a lamp the edge itself is visible.
        outline_px=chosen.outline_px if is_backlit else np.zeros(len(index)),
        spacing_px=chosen.spacing_px,
    )
    if sharpness is None:
        sharpness = sharpness_of(found)
    found = _with_corners(prediction, picture, index, again, found, sharpness, noise)
    shadow = np.zeros(len(index))
    if not is_backlit:
        shadow = shadow_shifts_px(part, prediction.scene, view, lamp, chosen, found)
    fits = []
    for i, feature in enumerate(prediction.features):
        mine = np.flatnonzero(owner == i)
        if len(mine) < settings.min_rays:
            fits.append(FeatureFit(key("no edge of it is in sight")))
            continue
        fits.append(
            _fit(
                feature,
                again.chosen(mine),
                prediction.curve[index[mine]],
                _some(found, mine),
                EITHER * shadow[mine],
                moved[i],
                PictureKind(is_backlit, noise, sharpness),
                settings,
                partial(
                    rival_px,
                    picture,
                    feature,
                    chosen.chosen(mine),
                    prediction.curve[index[mine]],
                    noise,
                ),
                partial(is_explained, part, prediction.scene, view, lamp, chosen.chosen(mine)),
            )
        )
    return fits, sharpness


def _with_corners(
    prediction: Prediction,
    picture: Grey,
    index: IndexArray,
    rays: Rays,
    found: EdgeFits,
    sharpness: Sharpness | None,
    noise: float,
) -> EdgeFits:
    """Return the found edges, with those in inner corners fitted anew between slopes of light.

    Parameters
    ----------
    prediction : prediction, with the original rays
    picture : the picture
    index : (n,) numbers of the rays
    rays, found : (n,) the rays across moved edges, and the edges found on them
    sharpness : sharpness of the view's edges; None where it is not known
    noise : rms noise of a pixel [grey]
    """
    inner = np.zeros(len(index), dtype=np.bool_)
    for i, feature in enumerate(prediction.features):
        mine = np.flatnonzero(prediction.feature[index] == i)
        inner[mine] = feature.level(prediction.curve[index[mine]]) > 0
    if sharpness is None or not inner.any():
        return found
    return measure_sloped_edges(
        picture, rays.pixels, rays.normals, found, sharpness.width_px, noise, inner
    )


def _first_look(
    prediction: Prediction,
    picture: Grey,
    index: IndexArray,
    rising: FloatArray | None,
    noise: float,
    counts: IndexArray,
) -> list[FloatArray]:
    """Return the unknowns of each feature from a look with a wide reach; zeros without a fit."""
    is_backlit = rising is not None
    rays, owner = prediction.rays, prediction.feature[index]
    stride = np.maximum(counts // FEW, 1)[owner] if len(owner) else owner
    place = np.arange(len(index)) - np.concatenate([[0], np.cumsum(counts)[:-1]])[owner]
    few = np.flatnonzero(place % np.maximum(stride, 1) == 0) if len(owner) else place
    sides = rays.chosen(index[few])
    found = measure_edges(
        picture,
        sides.pixels,
        sides.normals,
        np.minimum(sides.reach_px[:, 0 if is_backlit else 1], FAR_PX[is_backlit]),
        noise,
        None if rising is None else rising[few],
    )
    moved = []
    for i, feature in enumerate(prediction.features):
        mine = np.flatnonzero(owner[few] == i)
        start = np.zeros(feature.unknown_count)
        if len(mine) >= 2 * feature.unknown_count:
            some = sides.chosen(mine)
            # The opposite side of a small hole must not be taken for this side.
            radius = 1.0 / np.maximum(np.abs(some.curvature), 1e-6)
            offset = np.where(
                np.abs(found.offset_px[mine]) < FAR_SHARE * radius, found.offset_px[mine], np.nan
            )
            curve = prediction.curve[index[few[mine]]]
            design = feature.design(some, curve.astype(np.float64))
            variance = np.square(found.sigma_px[mine]) + SURE_PX**2
            answer = _solved(design * feature.sought_first, some, offset, variance)
            if answer is not None:
                # An edge is placed anew but not turned; its slope is found again.
                anew = np.where(feature.kept, answer.values, 0.0)
                # Hardly separable unknowns stay nominal if the second look reaches them from there.
                is_near = np.abs(design @ anew).max() <= NEAR_PX - SLACK_PX
                if feature.kept.all() or not is_near:
                    start = anew
        moved.append(start)
    return moved


def _placed_again(
    part: PosedPart, prediction: Prediction, moved: Sequence[FloatArray], index: IndexArray
) -> Rays:
    """Return some of the rays, placed anew across moved edges.

    Parameters
    ----------
    part : the part
    prediction : prediction, with the original rays
    moved : unknowns of each feature
    index : (n,) numbers of the rays, in order
    """
    which = prediction.rays.curve
    first = np.searchsorted(which, np.arange(int(which[-1]) + 1))
    wanted: dict[int, IndexArray] = {}
    for number in np.unique(which[index]).tolist():
        wanted[number] = index[which[index] == number] - first[number]
    curves = []
    number = 0
    for i, (feature, by) in enumerate(zip(prediction.features, moved, strict=True)):
        count = prediction.curve_counts[i]
        if any(number + k in wanted for k in range(count)):
            edges = feature.curves(part.solid, prediction.pixel_mm, by)
            curves += [
                edge.some(wanted[number + k])
                for k, edge in enumerate(edges)
                if number + k in wanted
            ]
        number += count
    view = prediction.view
    if not curves:
        return prediction.rays.chosen(index)
    return place_rays(curves, view.T_world_part_measured, view.task.camera)


def _solved(
    design: FloatArray, rays: Rays, offset: FloatArray, variance: FloatArray
) -> Solution | None:
    """Return the solution for the unknowns that any ray constrains, the others zero."""
    shown = np.abs(design).max(axis=0) > 0
    found = solve(design[:, shown], offset, variance, rays.spacing_px)
    if found is None or shown.all():
        return found
    count = len(shown)
    values, gain = np.zeros(count), np.zeros((count, len(offset)))
    noise = np.zeros((count, count))
    values[shown], gain[shown] = found.values, found.gain
    noise[np.ix_(shown, shown)] = found.noise
    return replace(found, values=values, gain=gain, noise=noise)


def _fit(
    feature: Feature,
    rays: Rays,
    curve: IndexArray,
    found: EdgeFits,
    shadow: FloatArray,
    moved: FloatArray,
    picture: PictureKind,
    settings: MeasuringSettings,
    beside_px: Callable[[FloatArray, float], float],
    is_another: Callable[[FloatArray], bool],
) -> FeatureFit:
    """Return a feature fitted to the edges found near it, or the reason for a failure.

    Parameters
    ----------
    feature : the feature
    rays, curve : rays that must show it, and the number of the edge that each crosses
    found : steps found along the rays
    shadow : (n,) standard uncertainties of their places by shadows that end beside the edge [px]
    moved : its unknowns so far
    picture, settings : required properties of edges
    beside_px : distance of a rival edge from the fit, given the contrast found
    is_another : test whether another edge of the part, or a shadow, explains the found place
    """
    good = found.is_found & (found.sigma_px <= settings.max_ray_px)
    points = rays.pixels + np.nan_to_num(found.offset_px)[:, None] * rays.normals
    little = ""
    level = feature.level(curve)
    for one in range(feature.level_count):
        if not (level == one).any():
            return FeatureFit(NOT_IN_SIGHT[one])
    share = min(float(good[level == one].mean()) for one in range(feature.level_count))
    if share < settings.min_share:
        little = say(
            "{percent:.0f} % of its edge found where it must show, {min_percent:.0f} % is required",
            percent=100 * share,
            min_percent=100 * settings.min_share,
        )
        # Before a panel an edge is lit wherever it is.
        least = np.inf if picture.is_backlit else settings.min_part
        if share < least or good.sum() < settings.min_rays:
            nowhere = np.zeros(len(good), dtype=np.bool_)
            return FeatureFit(little, points_px=points, accepted=nowhere)
    width = median(found.width_px[good])
    # Mean effects of blur on a round edge, of light on a wall at a grazing angle, and of the solid
    # where it blocks the light slightly beside the edge.
    blur = blur_shift_px(width, rays.curvature)
    lean = lean_px(found, good, picture)
    offset = found.offset_px + blur + lean
    offset = offset + rays.rising * (0.5 * rays.wall_px - rays.outline_px)
    wall = np.hypot(RECTANGLE * rays.wall_px, OUTLINE_KNOWN * rays.outline_px)
    variance = np.square(found.sigma_px) + np.square(wall) + np.square(shadow)
    design = feature.design(rays, curve.astype(np.float64))
    offset = np.where(good, offset, np.nan)
    chords = _chords_made(design, rays, offset, variance)
    answer = _solved(design, rays, offset - chords.share * chords.chord_px, variance)
    if answer is None:
        return FeatureFit(key("too little of its edge shows for a shape"), points_px=points)
    used = answer.used
    reason = failure_of(answer, good, rays, found, width, picture, settings, level)
    if not reason and is_another(design @ (moved + answer.values)):
        reason = ANOTHER
    edge_px = settings.backlit_edge_px if picture.is_backlit else settings.lit_edge_px
    if not picture.is_backlit:
        contrast = median(np.abs(found.contrast[used]))
        # Either of two edges may be the right one: U covers both.
        edge_px = float(np.hypot(edge_px, EITHER * beside_px(moved + answer.values, contrast)))
    form, form_u = form_of(answer, rays, curve, found)
    fitted = rays.pixels + (answer_place(feature, rays, curve, answer))[:, None] * rays.normals
    return FeatureFit(
        reason=reason or little,
        is_part=bool(little) and not reason,
        values_mm=moved + answer.values,
        noise=answer.noise,
        pose=answer.gain @ rays.pose,
        edge=answer.gain
        @ np.column_stack([edge_px * feature.light_modes(rays, curve), LEAN_KNOWN * lean]),
        wall=answer.gain @ (rays.rising * wall),
        shadow=answer.gain @ shadow,
        blur=answer.gain @ (BLUR_KNOWN * blur),
        facets=answer.gain @ (chords.share_u * chords.chord_px),
        points_px=points,
        accepted=used,
        shape_px=fitted,
        form_mm=form,
        form_u_mm=form_u,
        share=float(used.mean()),
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Made:
    """Share of its mesh's chords in a round edge.

    Attributes
    ----------
    share, share_u : 0 for a circle, 1 for the chords; and its standard uncertainty
    chord_px : (n,) offsets of the chords along the rays, at the turn that fits best
    """

    share: float
    share_u: float
    chord_px: FloatArray


def _chords_made(design: FloatArray, rays: Rays, offset: FloatArray, variance: FloatArray) -> _Made:
    """Return the share of its mesh's chords in a round edge, and its standard uncertainty.

    The corners of a mesh lie on the circle, its chords inside. A part made on a lathe is round; one
    printed or emulated from the mesh has the chords, and is narrower by two thirds of their height.
    A circle is even along the edge and chords are not, which a picture shows. The mesh may be
    turned against a part that looks the same from several sides. Where a picture cannot decide,
    both are equally likely.

    Parameters
    ----------
    design, rays, offset, variance : see `_solved`
    """
    unknown = _Made(0.5, 0.5, rays.chord_px[:, 0])
    if np.ptp(rays.chord_px) == 0:
        return unknown
    answers = [
        _solved(np.column_stack([design, chord]), rays, offset, variance)
        for chord in rays.chord_px.T
    ]
    told = [
        (float(one.values[-1]), turn, one) for turn, one in enumerate(answers) if one is not None
    ]
    if not told:
        return unknown
    seen, turn, answer = max(told, key=itemgetter(0))
    seen_u = float(np.sqrt(answer.noise[-1, -1]))
    known = float(np.hypot(seen_u, CHORDS_KNOWN))
    share = float(expit((seen - 0.5) / known**2))
    # An edge between the circle and the chords, or beyond them, is neither.
    between = max(abs(seen - share) - seen_u, 0.0)
    share_u = float(np.sqrt(share * (1.0 - share) + between**2 + CHORDS_KNOWN**2))
    return _Made(share, min(share_u, 0.5), rays.chord_px[:, turn])


def answer_place(feature: Feature, rays: Rays, curve: IndexArray, answer: Solution) -> FloatArray:
    """Return the place of the fitted shape on each ray (n,) [px].

    Parameters
    ----------
    feature : fitted feature
    rays, curve : rays across its edges, and the number of each one's edge
    answer : the fit
    """
    return np.asarray(feature.design(rays, curve.astype(np.float64)) @ answer.values)


def _some(found: EdgeFits, which: IndexArray | BoolArray) -> EdgeFits:
    return EdgeFits(*(getattr(found, name)[which] for name in found.__slots__))
