"""A lone part of which a piece was cut out is known by the edges about it; a detail is none."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from lit_pictures import Renderer, Scene, placed
from numpy.typing import NDArray
from table_pictures import coverage, overhead, resting, silhouette

from controller.cad import Solid, stable_poses
from controller.cad.compiled import compile_solid
from controller.imaging import PointLamp
from controller.recognition import Library, make_library
from controller.recognition.identification.decide import decide
from controller.recognition.identification.scene import TableScene
from controller.recognition.identification.wider import look_wider
from controller.recognition.segmentation import Region, brightest_of

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
CAMERA = overhead()
TABLE = np.array([[-150.0, -120, 0], [150, -120, 0], [150, 120, 0], [-150, 120, 0]])
LAMPS = [
    PointLamp.ring("ring", np.array([0.0, 0, 690]), np.array([0.0, 0, -1]), 120.0),
    PointLamp("side", np.array([[400.0, 350, 450]])),
]
BAR: Body = (
    box(70, 16, 8)
    - rod(5, 40, 48).translate((-27, 0, 0))
    - box(10, 6, 40).translate((28, 1, 0))
    - box(3, 9, 40).translate((34, -4, 0))
)


@cache
def bar() -> Solid:
    return solid_of(BAR, "bar")


@cache
def library() -> Library:
    plate = solid_of(box(60, 40, 10) - rod(6, 40, 48).translate((18, 8, 0)), "plate")
    return make_library([compile_solid(plate), compile_solid(bar())], CAMERA)


def pictures(solid: Solid, T: Array) -> list[Grey]:
    shots = Renderer(Scene(placed(solid.mesh, T), None, TABLE), CAMERA, seed=3)
    lit = [shots.lit(lamp) for lamp in LAMPS]
    return [brightest_of(lit), *lit]


def upright() -> Array:
    pose = next(p for p in stable_poses(bar()) if p.R[2, 2] > 0.99)
    return resting(bar(), pose.R, 8.0, -6.0, 0.5)


def covered(T: Array) -> NDArray[np.bool_]:
    return np.asarray(coverage(silhouette(bar().mesh, T, CAMERA)) > 0.5)


def piece_of(mask: NDArray[np.bool_], share: float) -> Region:
    """The left share of a mask of the whole picture."""
    v, u = np.nonzero(mask)
    right = int(u.min() + share * (u.max() - u.min()))
    x0, y0, x1, y1 = int(u.min()) - 4, int(v.min()) - 4, right + 4, int(v.max()) + 5
    own = mask[y0:y1, x0:x1].copy()
    own[:, right - x0 :] = False
    loop = np.array([[x0, y0], [x0, y1], [x1, y1], [x1, y0]], dtype=np.float64)
    return Region((x0, y0, x1, y1), own, (loop,), False, float(own.sum()), ())


@pytest.mark.parametrize("share", [0.6, 1.0])
def test_a_part_is_named_and_placed_from_a_piece_of_it(share: float) -> None:
    T = upright()
    seen = covered(T)
    region, _, hypotheses = look_wider(
        piece_of(seen, share),
        (),
        (),
        TableScene(pictures(bar(), T), CAMERA, library(), is_backlit=False),
    )
    best = decide(hypotheses, is_backlit=False).best
    assert best is not None
    assert library().entries[best.part].name == "bar"
    assert best.fit.T_world_part == pytest.approx(T, abs=0.1)
    assert region.mask.sum() > 0.95 * seen.sum()  # what the part covers belongs to the thing


def test_a_ridge_of_a_larger_thing_with_the_outline_of_a_part_is_no_part() -> None:
    T = upright()
    ridged = solid_of(box(84, 28, 3).translate((0, 0, -5.5)) + BAR, "ridged")
    T[2, 3] += 3.0  # the bar lies on the sheet that it is the ridge of
    _, _, hypotheses = look_wider(
        piece_of(covered(T), 1.0),
        (),
        (),
        TableScene(pictures(ridged, T), CAMERA, library(), is_backlit=False),
    )
    assert decide(hypotheses, is_backlit=False).best is None
