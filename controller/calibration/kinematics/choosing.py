"""Choice of pictures: the configurations that together determine the unknowns best.

Each candidate's pictures are predicted from the prior, and so is what they add to the knowledge of
all unknowns (docs/adr/0044). The one that adds most is taken, then the one that adds most to that:
the determinant of the information grows as fast as it can one at a time, and never by less than
63 % of what the best set of that size would reach, as the gain is submodular (Nemhauser, Wolsey and
Fisher 1978). For the same reason a gain that was worked out earlier is a bound for a later one, so
that only few have to be worked out again.
"""

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray, IndexArray
from controller.imaging import inverse_pose, transform

from ..camera import FoundBoard
from ._types import BoardPicture, CellPrior
from .layout import PictureTerms, UnknownsLayout
from .noise import whitening

_MARGIN_PX: Final = 40.0  # a cell as-built shows the board elsewhere in the picture
_FACING_MIN: Final = 0.5  # cosine between the print's normal and the line of sight
_CORNERS_MIN: Final = 12


@dataclass(frozen=True, slots=True, eq=False)
class PoseCandidate:
    """A configuration for a picture, free of contact according to the caller."""

    camera: str
    face: str
    grasp: str
    q: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ConfigurationChoice:
    """Configurations to go to.

    Attributes
    ----------
    indices : into the candidates, in the order in which they help most
    gain : increase of the logarithm of the information's determinant by each
    std : (m,) standard deviations of the unknowns that all of them will leave
    """

    indices: tuple[int, ...]
    gain: tuple[float, ...]
    std: FloatArray


def predicted_picture(
    layout: UnknownsLayout,
    x: FloatArray,
    candidate: PoseCandidate,
    corners_mm: FloatArray,
    name: str = "",
) -> BoardPicture | None:
    """Return the expected picture of a configuration, None if it does not show the board.

    Parameters
    ----------
    layout, x : the cell as it is known
    candidate : pose of the arm
    corners_mm : (n, 2) corners of the print
    name : name of the picture
    """
    prior = layout.prior
    camera = layout.camera(x, candidate.camera, np.inf)
    q = np.asarray(candidate.q, dtype=np.float64)
    T_arm_tcp = prior.arm.tcp(q[None], layout.arm_values(x))[0]
    T = layout.T_world_arm(x) @ T_arm_tcp @ layout.T_tcp_body(x, candidate.grasp)
    T = T @ prior.faces[candidate.face].T_body_board
    solid = np.column_stack([corners_mm, np.zeros(len(corners_mm))])
    p_world = solid @ T[:3, :3].T + T[:3, 3]
    depth = transform(inverse_pose(camera.T_world_cam), p_world)[:, 2]
    to_eye = camera.position_mm - p_world.mean(axis=0)
    if depth.min() <= 0.0 or T[:3, 2] @ to_eye < _FACING_MIN * np.linalg.norm(to_eye):
        return None
    pixels = camera.project(p_world)
    inside = np.all(
        (pixels > _MARGIN_PX) & (pixels < np.array(camera.size_px) - 1 - _MARGIN_PX), axis=1
    )
    if inside.sum() < min(_CORNERS_MIN, len(corners_mm)):
        return None
    board = FoundBoard(corners_mm[inside], pixels[inside], 0.0, 0.0)
    return BoardPicture(name, candidate.camera, candidate.face, board, candidate.grasp, candidate.q)


def choose(
    prior: CellPrior,
    candidates: Sequence[PoseCandidate],
    corners_mm: Mapping[str, FloatArray],
    count: int,
    *,
    on_table: Sequence[BoardPicture] = (),
    noise_px: float = 0.05,
) -> ConfigurationChoice:
    """Return the candidates that together determine the unknowns best.

    Parameters
    ----------
    prior : prior of the cell
    candidates : candidates within the arm's reach; those that show no board are skipped
    corners_mm : corners of each face, (n, 2)
    count : number of pictures
    on_table : pictures of the board on the table, which are there in any case
    noise_px : standard deviation expected of a corner's u or v
    """
    layout = UnknownsLayout(prior)
    x = np.zeros(layout.size)
    cov = np.eye(layout.size)  # in units of the prior's spread
    for terms in layout.evaluate(x, on_table):
        cov = _learnt(cov, *_information(layout, terms, noise_px, np.zeros(6)))
    pictures = [
        predicted_picture(layout, x, one, corners_mm[one.face], str(i))
        for i, one in enumerate(candidates)
    ]
    shown = [i for i, picture in enumerate(pictures) if picture is not None]
    evaluated = layout.evaluate(x, [p for p in pictures if p is not None])
    brings = {
        i: _information(layout, terms, noise_px, prior.joint_std)
        for i, terms in zip(shown, evaluated, strict=True)
    }
    # the largest bound first; (-gain, index, how many were chosen when it was worked out)
    heap = [(-_gain(cov, *brings[i]), i, 0) for i in shown]
    heapq.heapify(heap)
    chosen: list[int] = []
    gains: list[float] = []
    while heap and len(chosen) < count:
        bound, i, known_at = heapq.heappop(heap)
        if known_at == len(chosen):
            chosen.append(i)
            gains.append(-bound)
            cov = _learnt(cov, *brings[i])
        else:
            heapq.heappush(heap, (-_gain(cov, *brings[i]), i, len(chosen)))
    return ConfigurationChoice(tuple(chosen), tuple(gains), np.sqrt(np.diag(cov)) * layout.std)


def _information(
    layout: UnknownsLayout, terms: PictureTerms, noise_px: float, joint_std: FloatArray
) -> tuple[FloatArray, IndexArray]:
    """Return rows (k, c) with a picture's information as their squares, and their columns (c,)."""
    used = np.ones(len(terms.residual_px), dtype=bool)
    white = whitening(terms, used, noise_px, joint_std)
    by = white.apply(terms.by_unknowns.reshape(2 * len(used), -1)) * layout.std[terms.columns]
    _, rows = np.linalg.qr(by)
    return rows, terms.columns


def _gain(cov: FloatArray, rows: FloatArray, at: IndexArray) -> float:
    inside = np.eye(len(rows)) + rows @ cov[np.ix_(at, at)] @ rows.T
    return float(np.linalg.slogdet(inside)[1])


def _learnt(cov: FloatArray, rows: FloatArray, at: IndexArray) -> FloatArray:
    """Return the covariance (m, m) after adding a picture's rows."""
    across = cov[:, at] @ rows.T
    inside = np.eye(len(rows)) + rows @ across[at]
    out: FloatArray = cov - across @ np.linalg.solve(inside, across.T)
    return (out + out.T) / 2.0
