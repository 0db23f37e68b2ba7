"""Features fitted in one picture: rays across their predicted edges, twice, and self-checks.

The first look goes far, along some of the rays, for a dimension may be wrong by many pixels. The
second goes along all of them, placed anew where the first found the edge, so that each crosses it
squarely and in its middle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Final

import numpy as np
from scipy.special import expit

from controller.arrays import BoolArray, FloatArray, Grey, IndexArray, median
from controller.imaging import EdgeFits, blur_shift_px, measure_edges, transform
from controller.imaging.levels import pixel_noise

from .._pose import PosedPart
from .._scene import ViewScene, make_scene
from ._checks import SURE_PX, PictureKind, Sharpness, failure_of, form_of, lean_px, sharpness_of
from ._features import Feature, FeatureFit
from ._foreseen import is_explained
from ._rays import Rays, place_rays, with_outline, with_rotation, with_visibility
from ._rivals import rival_px
from ._types import BACKLIT, MeasuringSettings, PosedView
from .solving import Solution, solve

# Reach of the first look; before a panel no other edge looks alike.
FAR_PX: Final = {True: 16.0, False: 6.0}
FAR_SHARE: Final = 0.6  # largest reach as a share of a radius; farther off is the other side
NEAR_PX: Final = 2.5
SLACK_PX: Final = 1.0  # reach added to the second look for the first look's error
LEAN_KNOWN: Final = 0.3  # standard uncertainty of a lean, as a share of it
FEW: Final = 32  # rays of the first look
EITHER: Final = 1 / 3**0.5  # standard deviation of a rectangle, of half its width
RECTANGLE: Final = 1 / 12**0.5  # standard deviation of a rectangle, of its width
# Standard uncertainty of the light's end beside a CAD edge, as a share of the distance.
OUTLINE_KNOWN: Final = 0.5
BLUR_KNOWN: Final = 0.1  # difference of a lens's blur from a Gaussian one, as a share
# Uncertainty as a share of a chord's height; blur rounds the corners between chords.
CHORDS_KNOWN: Final = 0.1
ANOTHER: Final = "another edge of the part, or a shadow's border, belongs where it was found"
WAVES: Final = 3  # waves round a circle by which light may move its edge


@dataclass(frozen=True, eq=False, slots=True)
class Prediction:
    """Predicted edges of features in a view.

    Attributes
    ----------
    view, scene : the view, and what else stands there
    features : in order
    rays : across all their edges
    feature, curve : (n,) which feature each ray is of, and which of its edges, from 0
    curve_counts : how many edges each feature has
    pixel_mm : size of a pixel at the part
    pivot_mm : (3,) world, about which its rotation is uncertain
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
    view : with its pose
    features : of the part
    """
    camera, T = view.task.camera, view.T_world_part
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
    """Return one picture's fit of each feature, and the sharpness of its edges.

    Parameters
    ----------
    part : the part
    prediction : what must show
    lamp : which picture, `BACKLIT` or a lamp
    sharpness : of the view's backlit picture; None for that itself
    settings : when a measurement counts
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
        with_rotation(again, view.T_world_part, prediction.pivot_mm),
        rising=chosen.rising,
        wall_px=chosen.wall_px,
        # under a lamp the edge itself shows
        outline_px=chosen.outline_px if is_backlit else np.zeros(len(index)),
        spacing_px=chosen.spacing_px,
    )
    if sharpness is None:
        sharpness = sharpness_of(found)
    fits = []
    for i, feature in enumerate(prediction.features):
        mine = np.flatnonzero(owner == i)
        if len(mine) < settings.min_rays:
            fits.append(FeatureFit("no edge of it is in sight"))
            continue
        fits.append(
            _fit(
                feature,
                again.chosen(mine),
                prediction.curve[index[mine]],
                _some(found, mine),
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


def _first_look(
    prediction: Prediction,
    picture: Grey,
    index: IndexArray,
    rising: FloatArray | None,
    noise: float,
    counts: IndexArray,
) -> list[FloatArray]:
    """Return the unknowns of each feature by a look with a wide reach, zeros where it has none."""
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
            # the other side of a small hole is no edge of this side
            radius = 1.0 / np.maximum(np.abs(some.curvature), 1e-6)
            offset = np.where(
                np.abs(found.offset_px[mine]) < FAR_SHARE * radius, found.offset_px[mine], np.nan
            )
            curve = prediction.curve[index[few[mine]]]
            design = feature.design(some, curve.astype(np.float64))
            variance = np.square(found.sigma_px[mine]) + SURE_PX**2
            answer = _solved(design * feature.sought_first, some, offset, variance)
            if answer is not None:
                # an edge is placed anew, and not turned: its slope is found again
                anew = np.where(feature.kept, answer.values, 0.0)
                # of unknowns hardly told apart, what a second look reaches from nominal stays there
                is_near = np.abs(design @ anew).max() <= NEAR_PX - SLACK_PX
                if feature.kept.all() or not is_near:
                    start = anew
        moved.append(start)
    return moved


def _placed_again(
    part: PosedPart, prediction: Prediction, moved: Sequence[FloatArray], index: IndexArray
) -> Rays:
    """Return some of the rays, placed anew across edges that have moved.

    Parameters
    ----------
    part : the part
    prediction : with the rays as they were placed
    moved : of each feature, its unknowns
    index : (n,) which rays, in order
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
    return place_rays(curves, view.T_world_part, view.task.camera)


def _solved(
    design: FloatArray, rays: Rays, offset: FloatArray, variance: FloatArray
) -> Solution | None:
    """Return the solution for the unknowns that any ray shows, the others zero."""
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
    moved: FloatArray,
    picture: PictureKind,
    settings: MeasuringSettings,
    beside_px: Callable[[FloatArray, float], float],
    is_another: Callable[[FloatArray], bool],
) -> FeatureFit:
    """Return a feature fitted to the edges found beside it, or the reason for a failure.

    Parameters
    ----------
    feature : what is fitted
    rays, curve : those that must show it, and which of its edges each crosses
    found : what they crossed
    moved : its unknowns so far
    picture, settings : what edges must be like
    beside_px : how far from where it was found, of so much contrast, another edge shows
    is_another : whether another edge of the part, or a shadow, belongs where it was found
    """
    good = found.is_found & (found.sigma_px <= settings.max_ray_px)
    points = rays.pixels + np.nan_to_num(found.offset_px)[:, None] * rays.normals
    little = ""
    if good.sum() < settings.min_share * len(good):
        little = (
            f"{100 * good.mean():.0f} % of its edge found where it must show, "
            f"{100 * settings.min_share:.0f} % is required"
        )
        # before a panel an edge has light wherever it is
        least = np.inf if picture.is_backlit else settings.min_part * len(good)
        if good.sum() < max(least, settings.min_rays):
            nowhere = np.zeros(len(good), dtype=np.bool_)
            return FeatureFit(little, points_px=points, accepted=nowhere)
    width = median(found.width_px[good])
    # what blur does to a round edge, what light on a wall seen flat does on the average, and what
    # of the part ends the light a little beside the edge
    blur = blur_shift_px(width, rays.curvature)
    lean = lean_px(found, good, picture)
    offset = found.offset_px + blur + lean
    offset = offset + rays.rising * (0.5 * rays.wall_px - rays.outline_px)
    wall = np.hypot(RECTANGLE * rays.wall_px, OUTLINE_KNOWN * rays.outline_px)
    variance = np.square(found.sigma_px) + np.square(wall)
    design = feature.design(rays, curve.astype(np.float64))
    offset = np.where(good, offset, np.nan)
    chords = _chords_made(design, rays, offset, variance)
    answer = _solved(design, rays, offset - chords.share * chords.chord_px, variance)
    if answer is None:
        return FeatureFit("too little of its edge shows for a shape", points_px=points)
    used = answer.used
    reason = failure_of(answer, good, rays, found, width, picture, settings)
    if not reason and is_another(design @ (moved + answer.values)):
        reason = ANOTHER
    edge_px = settings.backlit_edge_px if picture.is_backlit else settings.lit_edge_px
    if not picture.is_backlit:
        contrast = median(np.abs(found.contrast[used]))
        # either of two edges may be the one: U covers both
        edge_px = float(np.hypot(edge_px, EITHER * beside_px(moved + answer.values, contrast)))
    form, form_u = form_of(answer, rays, curve, found)
    fitted = rays.pixels + (answer_place(feature, rays, curve, answer))[:, None] * rays.normals
    return FeatureFit(
        reason=reason or little,
        is_part=bool(little) and not reason,
        values_mm=moved + answer.values,
        noise=answer.noise,
        pose=answer.gain @ rays.pose,
        edge=answer.gain @ np.column_stack([edge_px * _modes(feature, rays), LEAN_KNOWN * lean]),
        wall=answer.gain @ (rays.rising * wall),
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
    """What a round edge has of its mesh's chords.

    Attributes
    ----------
    share, share_u : 0 for a circle, 1 for the chords, and the standard uncertainty
    chord_px : (n,) where the chords are along the rays, turned as they show most
    """

    share: float
    share_u: float
    chord_px: FloatArray


def _chords_made(design: FloatArray, rays: Rays, offset: FloatArray, variance: FloatArray) -> _Made:
    """Return the share of its mesh's chords in a round edge, and the standard uncertainty.

    A mesh's corners lie on the circle, its chords inside. A part that was turned is round; one that
    was printed or emulated from the mesh has the chords, and is narrower by two thirds of their
    height. Along the edge the one is even and the other is not, which a picture shows. The mesh may
    be turned against the part, where that looks alike from several sides. Where no picture tells,
    both are as likely.

    Parameters
    ----------
    design, rays, offset, variance : as `_solved` has them
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
    # what lies between a circle and the chords, or beyond, is neither
    between = max(abs(seen - share) - seen_u, 0.0)
    share_u = float(np.sqrt(share * (1.0 - share) + between**2 + CHORDS_KNOWN**2))
    return _Made(share, min(share_u, 0.5), rays.chord_px[:, turn])


def _modes(feature: Feature, rays: Rays) -> FloatArray:
    """Return the modes (n, k) in which light may move an edge: as a whole, and unevenly.

    Round a whole circle only the first moves a radius and the next two a place. Of an arc that
    shows, all the rest are taken for one or the other as well.

    Parameters
    ----------
    feature : that they are taken for
    rays : across its edges
    """
    angle = feature.light_angles(rays)
    waves = [wave(k * angle) for k in range(1, WAVES + 1) for wave in (np.cos, np.sin)]
    return np.column_stack([rays.outward, *waves])


def answer_place(feature: Feature, rays: Rays, curve: IndexArray, answer: Solution) -> FloatArray:
    """Return the place of the fitted shape on each ray (n,) [px].

    Parameters
    ----------
    feature : what was fitted
    rays, curve : across its edges
    answer : the fit
    """
    return np.asarray(feature.design(rays, curve.astype(np.float64)) @ answer.values)


def _some(found: EdgeFits, which: IndexArray | BoolArray) -> EdgeFits:
    return EdgeFits(*(getattr(found, name)[which] for name in found.__slots__))
