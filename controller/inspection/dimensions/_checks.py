"""Self-checks of found edges: sharpness, form, and whether they count."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray, median
from controller.imaging import EdgeFits
from messages import say

from ._rays import Rays
from ._types import MeasuringSettings
from .solving import Solution

FORM_POINTS: Final = 5  # neighbours averaged to a point of the form
FAINT: Final = 2.0  # error of a ray, in errors of the better rays, from which it shows no form
SURE_PX: Final = 0.1  # largest standard error of a ray used for the picture's sharpness
MIN_SURE: Final = 20
# Error of a fitted edge as a multiple of the amount by which its fit is too narrow. For two blurred
# steps taken for one, up by one and back by 0.4 to 0.9 within 2 to 4 px, it is 1.5 to 2.1; it is
# more where the profile falls back gradually.
LEAN: Final = 2.0


@dataclass(frozen=True, slots=True)
class Sharpness:
    """Common properties of the edges of a backlit picture: width [px] and contrast [grey]."""

    width_px: float
    contrast: float


@dataclass(frozen=True, slots=True)
class PictureKind:
    """Properties for judging a picture's edges: light, noise [grey] and sharpness."""

    is_backlit: bool
    noise: float
    sharpness: Sharpness | None


def lean_px(found: EdgeFits, good: BoolArray, picture: PictureKind) -> FloatArray:
    """Return the bias of steps (n,) whose profile falls back behind them [px].

    Beside a dark line, such as the shaded foot of a bore's wall, a blurred step does not level off:
    its fit is too narrow, and is biased away from the line by `LEAN` times the missing width.

    Parameters
    ----------
    found : fitted steps
    good : (n,) mask of the sure steps
    picture : properties of the picture
    """
    lean = np.zeros(len(good))
    for side in (-1.0, 1.0):
        mine = good & (found.back == side)
        if picture.is_backlit or picture.sharpness is None or mine.sum() < FORM_POINTS:
            continue
        narrow = picture.sharpness.width_px - median(found.width_px[mine])
        lean[mine] = side * LEAN * max(narrow, 0.0)
    return lean


def form_of(
    answer: Solution, rays: Rays, curve: IndexArray, found: EdgeFits
) -> tuple[float, float]:
    """Return the form deviation of an edge, peak to valley, and its standard uncertainty [mm].

    Walls seen at a grazing angle and faint edges show no form. Neighbours are averaged along each
    edge.

    Parameters
    ----------
    answer, rays, curve, found : see `failure_of`
    """
    u_mm = found.sigma_px / np.maximum(rays.px_per_mm, 1e-9)
    clear = answer.used & (rays.wall_px == 0)
    if clear.sum() < FORM_POINTS:
        return 0.0, float("inf")
    clear &= u_mm <= FAINT * np.percentile(u_mm[clear], 25)
    most, u_most = 0.0, float("inf")
    for one in np.unique(curve):
        mine = np.flatnonzero(clear & (curve == one))
        if len(mine) < 2 * FORM_POINTS:
            continue
        off = answer.residuals[mine] / np.maximum(rays.px_per_mm[mine], 1e-9)
        smooth = np.convolve(off, np.full(FORM_POINTS, 1.0 / FORM_POINTS), mode="valid")
        # Rays less than a pixel apart share one noise.
        count = max(FORM_POINTS * min(median(rays.spacing_px[mine]), 1.0), 1.0)
        u_both = median(u_mm[mine]) * float(np.sqrt(2.0 / count))
        most = max(most, float(np.ptp(smooth)))
        u_most = min(u_most, u_both)
    return most, u_most


def failure_of(
    answer: Solution,
    good: BoolArray,
    rays: Rays,
    found: EdgeFits,
    width: float,
    picture: PictureKind,
    settings: MeasuringSettings,
    level: IndexArray,
) -> str:
    """Return the failed self-check; empty where all passed.

    Parameters
    ----------
    answer : the fit
    good : (n,) mask of the rays with an edge
    rays, found, width, picture, settings : see `failure_of`
    level : (n,) level of each ray's edge; each level needs its share
    """
    used = answer.used
    for one in np.unique(level):
        share, shown = float(used[level == one].mean()), float(good[level == one].mean())
        # Where light hides the rest, the same share of the visible rays is required.
        if share < settings.min_share * (shown if shown < settings.min_share else 1.0):
            return say(
                "{percent:.0f} % of its edge lies on the fitted shape, "
                "{min_percent:.0f} % is required",
                percent=100 * share,
                min_percent=100 * settings.min_share,
            )
    burnt = float(found.burnt[used].mean())
    if burnt > settings.max_burnt:
        return say(
            "{burnt_percent:.0f} % of the pixels beside its edge are burnt out",
            burnt_percent=100 * burnt,
        )
    low, high = settings.width_px
    if not low <= width <= high:
        return say(
            "its edge is {width:.2f} px wide, a lens in focus makes {low:.2f} to {high:.1f} px",
            width=width,
            low=low,
            high=high,
        )
    sharp = picture.sharpness
    if sharp is not None:
        if abs(width / sharp.width_px - 1.0) > settings.max_width_change:
            return say(
                "its edge is {width:.2f} px wide, the picture's other edges are "
                "{width_px:.2f} px: not one edge, or out of focus",
                width=width,
                width_px=sharp.width_px,
            )
        contrast = median(np.abs(found.contrast[used]))
        least = settings.min_contrast_share * sharp.contrast
        if picture.is_backlit and contrast < least:
            return say(
                "its contrast is {contrast:.0f} grey levels, {least:.0f} are "
                "required: light on its wall hides the edge",
                contrast=contrast,
                least=least,
            )
    residual = median(found.residual[used])
    height = median(np.abs(found.contrast[used]))
    most = 3.0 * picture.noise + settings.max_profile * height
    if residual > most:
        return say(
            "the light across its edge is off a blurred step by {residual:.1f} "
            "grey levels, {most:.1f} is allowed",
            residual=residual,
            most=most,
        )
    scatter_limit = settings.max_form_px + 3.0 * median(found.sigma_px[used])
    if answer.scatter > scatter_limit:
        return say(
            "its edge scatters by {scatter:.2f} px about the fitted shape, "
            "{scatter_limit:.2f} px is allowed",
            scatter=answer.scatter,
            scatter_limit=scatter_limit,
        )
    return ""


def sharpness_of(found: EdgeFits) -> Sharpness | None:
    """Return the common width and contrast of the sure edges; None where there are too few."""
    sure = found.is_found & (found.sigma_px < SURE_PX)
    if sure.sum() < MIN_SURE:
        return None
    return Sharpness(median(found.width_px[sure]), median(np.abs(found.contrast[sure])))
