"""The coverage map: the surface that the plan shows, how often, and why not the rest."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import Float32Array, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.planning import Plan, Reason

from ..ray_drawing import FINER, smaller
from .bodies import make_stage, part_body
from .paint import Painter
from .render import data_uri, look, shade
from .views import slant_over, slanting_eye

Colour = tuple[float, float, float]

SIZE_PX = (270, 216)
ELEVATION_RAD = float(np.radians(32.0))
AZIMUTHS_DEG = (-60, 30, 120, 210)
# Strength of light and shadow on the colours, which must stay comparable with the key.
RELIEF = 0.45
# Rays start this many sizes of the part away.
FAR_SIZES = 3.0

# Least number of views, its words, and its colour.
OFTEN = (
    (1, "in sight in 1 view", (168.0, 206.0, 238.0)),
    (2, "in sight in 2 views", (92.0, 158.0, 214.0)),
    (3, "in sight in 3 views or more", (28.0, 98.0, 168.0)),
)
WHY: dict[Reason, Colour] = {
    Reason.HIDDEN_BY_PART: (128.0, 88.0, 160.0),
    Reason.FINGERS: (240.0, 170.0, 40.0),
    Reason.REACH: (214.0, 84.0, 20.0),
    Reason.NO_REGRASP_PATH: (226.0, 120.0, 176.0),
    Reason.GRASP_STRENGTH: (236.0, 222.0, 70.0),
    Reason.LEFT_OUT: (96.0, 96.0, 96.0),
}
SPECKS: Colour = (232.0, 232.0, 228.0)
SPECKS_WORDS = "single samples, too small to be listed"


@dataclass(frozen=True, slots=True)
class Key:
    """One colour of the map.

    Attributes
    ----------
    share : share of all surface
    """

    words: str
    colour: str
    share: float


@dataclass(frozen=True, slots=True)
class PartSide:
    """The part from one side, as a data URI."""

    words: str
    picture: str


@dataclass(frozen=True, slots=True)
class CoverageMap:
    """The part from all sides, and the key of its colours."""

    sides: tuple[PartSide, ...]
    keys: tuple[Key, ...]
    size: tuple[int, int]


def coverage_map(
    solid: Solid,
    samples: SurfaceSamples,
    plan: Plan,
    painter: Painter,
    R_world_part: FloatArray,
) -> CoverageMap:
    """Return the map of a plan.

    Parameters
    ----------
    solid : the part
    samples : its surface samples; their areas are the weights
    plan : plan with the samples of each view, and the reasons for the rest
    painter : colours of the part by its samples
    R_world_part : (3, 3) rotation in which it is drawn
    """
    weights = samples.areas_mm2 / samples.areas_mm2.sum()
    words, colours = states(samples, plan)
    names = [name for _, name, _ in OFTEN] + [kind.value for kind in WHY] + [SPECKS_WORDS]
    table = [c for _, _, c in OFTEN] + list(WHY.values()) + [SPECKS]
    keys = tuple(
        Key(name if i < len(OFTEN) or i == len(names) - 1 else f"not in sight: {name}",
            "#" + "".join(f"{round(v):02x}" for v in table[i]), float(weights[words == i].sum()))
        for i, name in enumerate(names)
        if (words == i).any()
    )  # fmt: skip
    return CoverageMap(_sides(solid, painter, R_world_part, colours), keys, SIZE_PX)


def states(samples: SurfaceSamples, plan: Plan) -> tuple[IntArray, Float32Array]:
    """Return each sample's number in the key (n,), and its colour (n, 3)."""
    counts = np.zeros(len(samples.points_mm), dtype=np.int64)
    for step in plan.steps:
        seen = getattr(step, "seen", None)
        if seen is not None:
            counts += seen
    kinds = list(WHY)
    state = np.full(len(counts), len(OFTEN) + len(kinds))
    for u in plan.unseen:
        state[list(u.samples)] = len(OFTEN) + kinds.index(u.kind)
    state[counts > 0] = np.minimum(counts[counts > 0], len(OFTEN)) - 1
    colours = np.array([c for _, _, c in OFTEN] + list(WHY.values()) + [SPECKS], dtype=np.float32)
    return state, colours[state]


def _sides(
    solid: Solid, painter: Painter, R_world_part: FloatArray, colours: Float32Array
) -> tuple[PartSide, ...]:
    T = np.eye(4)
    T[:3, :3] = R_world_part
    T[:3, 3] = -R_world_part @ solid.centroid_mm
    body = part_body(solid, T)
    stage = make_stage([], body, T)
    size_mm = float(np.linalg.norm(np.ptp(body.vertices_mm, axis=0)))
    fine = (FINER * SIZE_PX[0], FINER * SIZE_PX[1])
    sides = []
    for elevation, above in ((ELEVATION_RAD, "from above"), (-ELEVATION_RAD, "from below")):
        for azimuth_deg in AZIMUTHS_DEG:
            azimuth = float(np.radians(azimuth_deg))
            slant = slant_over(body.vertices_mm, azimuth, elevation, SIZE_PX[0] / SIZE_PX[1], 0.05)
            eye = slanting_eye(slant, fine, FAR_SIZES * size_mm)
            hits = look(stage, eye)
            paint = painter.paint(stage, hits, colours)
            image = smaller(shade(stage, eye, hits, paint, RELIEF))
            sides.append(PartSide(f"{above}, {azimuth_deg % 360}°", data_uri(image)))
    return tuple(sides)
