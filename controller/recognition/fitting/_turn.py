"""The turn of a part about an axis to which its outline is blind, by the edges that lamps show.

A shaft that stands on its end is a circle from above, and almost the same outline from any side.
What tells its turn lies inside: the rim of a cross hole, a keyway. All turns are tried, and each is
weighed by how unusual the slopes of the pictures are where it puts edges.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey, IntArray
from controller.imaging import Camera, sample_picture, slopes_of, transform

from ._fit import twist
from ._model import EdgeModel
from ._predict import ModelEdgePoints, predict_edges

COMMON_RAD: Final = np.radians(15.0)  # between turns that are asked which edges all of them have
STEP_RAD: Final = np.radians(3.0)  # of the search: edges of other turns are a pixel or more apart
TURNS: Final = np.arange(-np.pi, np.pi - STEP_RAD / 2, STEP_RAD)
FINE_RAD: Final = np.radians(0.5)  # of the search about the best one
# Turns this near the best one show the same edges, a little off: by one view alone the turn of a
# shaft was off by 5 degrees at most.
SAME_RAD: Final = np.radians(9.0)
# Log-odds by which the best turn must lead. In 122 pictures of a shaft, each by itself, wrong turns
# led by 10 at most, and 75 right ones by more than this (docs/measurements/inspection.md).
DECIDED: Final = 20.0
VERTICAL_COS: Final = float(np.cos(np.pi / 4))  # an axis is nearer to the vertical, or lies
SURE: Final = 100.0  # a lead of two or three good views
SPUN_RAD: Final = np.radians(3.0)  # a round part turned so far in round jaws that took it over
NEAR_PX: Final = 1.5  # distance from its prediction within which an edge is looked for
AT_PX: Final = 0.5  # the same about the best turn: an edge is where it is
RIM_PX: Final = 4  # what lies nearer to the outline is its slope, not an edge inside
PIECE_PX: Final = 5.0  # neighbouring points of an edge that show the same
SAMPLE_COUNT: Final = 600  # edge samples looked at for each turn
CHANCE_COUNT: Final = 3000  # places that tell which slopes are usual
# Density of the share u of usual slopes above an edge's: a u^(a-1). One edge in two is then among
# the strongest tenth, and the log-odds of an edge that does not show at all are log a.
EDGE_POWER: Final = 0.3


@dataclass(frozen=True, eq=False, slots=True)
class FreeTurn:
    """An axis about which a part's turn is a guess.

    Attributes
    ----------
    axis : (3,) unit, CAD frame
    through_mm : (3,) a point on it, CAD frame
    same_rad : turns about it that leave the part as it is, 0 among them
    is_shown : a view has shown the turn, roughly
    guess_number : of the guess; views of an earlier one were expected at a turn that was wrong
    """

    axis: FloatArray
    through_mm: FloatArray
    same_rad: FloatArray
    is_shown: bool = False
    guess_number: int = 0

    def shown(self, off_rad: float) -> "FreeTurn":
        """Return it once a view has shown the turn.

        A turn that was shown before, and is off by more than round jaws let a part turn, was wrong:
        the present one is another guess.

        Parameters
        ----------
        off_rad : turn shown, from the one expected
        """
        is_other = self.is_shown and off_rad > SAME_RAD
        return replace(self, is_shown=True, guess_number=self.guess_number + int(is_other))

    def by(self, turn_rad: float) -> FloatArray:
        """Return the turn (4, 4) of the part, in its CAD frame."""
        return twist(turn_rad * self.axis, np.zeros(3), self.through_mm)

    def is_vertical(self, T_world_part: FloatArray) -> bool:
        """Return True if the turn is one about the vertical, of a part on the table (4, 4)."""
        return bool(abs(T_world_part[2, :3] @ self.axis) > VERTICAL_COS)

    def is_same(self, turns_rad: FloatArray, as_rad: float) -> BoolArray:
        """Return a mask of the turns (k,) that a picture could not tell from another one."""
        off = turns_rad[:, None] - as_rad - self.same_rad
        off = np.abs((off + np.pi) % (2 * np.pi) - np.pi)
        return np.asarray((off <= SAME_RAD).any(axis=1))


@dataclass(frozen=True, eq=False)
class TurnPictures:
    """Pictures under lamps, from one place, of a part whose turn is sought.

    Attributes
    ----------
    free : the axis
    model : edges of the part
    T_world_part : (4, 4) its pose at turn 0
    camera : of the pictures
    pictures : (h, w) grey, or crops of them
    corner_px : (x0, y0) corner of the crops in the picture
    inside : (h, w) mask of the part's pixels, its rim and what may hide it left out
    """

    free: FreeTurn
    model: EdgeModel
    T_world_part: FloatArray
    camera: Camera
    pictures: Sequence[Grey]
    corner_px: tuple[int, int]
    inside: BoolArray

    @cached_property
    def odds(self) -> FloatArray:
        """Log-odds of each of `TURNS`."""
        return self.log_odds(TURNS, NEAR_PX)

    def log_odds(self, turns_rad: FloatArray, near_px: float, least: float = -np.inf) -> FloatArray:
        """Return the log-odds (k,) of turns against "no edge where it puts them".

        Parameters
        ----------
        turns_rad : (k,) about the axis
        near_px : distance from its prediction within which an edge is looked for
        least : least log-odds of an edge; 0 where one that does not show says nothing
        """
        edges = [self._telling(turn) for turn in turns_rad.tolist()]
        normals = np.concatenate([one.normals for one in edges])
        y, x = np.nonzero(self.inside)
        if len(x) == 0 or len(normals) == 0:
            return np.zeros(len(turns_rad))
        # evenly over the part and over all directions that edges may have
        at = np.linspace(0, len(x) - 1, CHANCE_COUNT).astype(np.intp)
        along = normals[np.arange(CHANCE_COUNT) * len(normals) // CHANCE_COUNT]
        usual = np.sort(_strongest(self._slopes, np.column_stack([x[at], y[at]]), along, near_px))
        pixel_mm = self.camera.mm_per_px(
            transform(self.T_world_part, self.model.centroid_mm[None])[0]
        )
        found = np.zeros(len(turns_rad))
        for k, one in enumerate(edges):
            places = one.pixels - np.array(self.corner_px)
            here = _strongest(self._slopes, places, one.normals, near_px)
            above = 1.0 - np.searchsorted(usual, here) / CHANCE_COUNT
            share = np.maximum(above, 1.0 / CHANCE_COUNT)
            odds = np.log(EDGE_POWER) + (EDGE_POWER - 1.0) * np.log(share)
            found[k] = np.maximum(odds, least).sum() * one.step_mm / pixel_mm / PIECE_PX
        return found

    @cached_property
    def _slopes(self) -> tuple[tuple[Float32Array, Float32Array], ...]:
        return tuple(slopes_of(picture) for picture in self.pictures)

    @cached_property
    def _everywhere(self) -> BoolArray:
        """Mask (h, w) of the pixels with an edge at most turns, which tell none of them."""
        turns = np.arange(0.0, 2 * np.pi, COMMON_RAD)
        about = np.ones((2 * round(NEAR_PX) + 1,) * 2, np.uint8)
        counts = np.zeros(self.inside.shape, dtype=np.int64)
        for turn in turns.tolist():
            hit = np.zeros(self.inside.shape, dtype=np.uint8)
            x, y = self._pixels(self._edges(turn)).T
            hit[y, x] = 1
            counts += cv2.dilate(hit, about) > 0
        return np.asarray(2 * counts > len(turns))

    def _telling(self, turn_rad: float) -> ModelEdgePoints:
        """Return the edges at a turn that are not there at most others as well."""
        edges = self._edges(turn_rad)
        x, y = self._pixels(edges).T
        return edges.at(~self._everywhere[y, x])

    def _pixels(self, edges: ModelEdgePoints) -> IntArray:
        """Return the pixels (n, 2) of edges in the crops."""
        return np.asarray(np.round(edges.pixels).astype(np.int64) - np.array(self.corner_px))

    def _edges(self, turn_rad: float) -> ModelEdgePoints:
        """Return the edges inside the outline, where nothing else may be seen."""
        T_world_part = self.T_world_part @ self.free.by(turn_rad)
        edges = predict_edges(self.model, T_world_part, self.camera, SAMPLE_COUNT)
        x, y = self._pixels(edges).T
        height, width = self.inside.shape
        shown = ~edges.on_outline & (x >= 0) & (y >= 0) & (x < width) & (y < height)
        shown[shown] = self.inside[y[shown], x[shown]]
        return edges.at(shown)


@dataclass(frozen=True, slots=True)
class Turn:
    """The likeliest turn about an axis.

    Attributes
    ----------
    turn_rad : the turn
    is_decided : the pictures rule out all others that they could tell from it, or a view before
        them did
    is_sure : by so much that further pictures would not change it
    """

    turn_rad: float
    is_decided: bool
    is_sure: bool


def likeliest_turn(free: FreeTurn, views: Sequence[TurnPictures]) -> Turn:
    """Return the turn that pictures from some places show best, to `STEP_RAD`.

    Parameters
    ----------
    free : the axis
    views : of the part, at one turn in all of them
    """
    odds = np.zeros(len(TURNS))
    for view in views:
        odds += view.odds
    best = float(TURNS[int(odds.argmax())])
    others = odds[~free.is_same(TURNS, best)]
    lead = float(odds.max() - others.max(initial=0.0))
    if lead < DECIDED and free.is_shown:
        return Turn(0.0, is_decided=True, is_sure=False)
    return Turn(best, is_decided=lead >= DECIDED, is_sure=lead >= SURE)


def refined_turn(views: Sequence[TurnPictures], near_rad: float) -> float:
    """Return the turn [rad] of the part in one grasp, near that of other ones.

    Parameters
    ----------
    views : of the grasp
    near_rad : turn of the part before it was handed over, or roughly
    """
    about = np.arange(-SAME_RAD, SAME_RAD + FINE_RAD, 2 * FINE_RAD)
    odds = _found_by(views, near_rad + about, NEAR_PX) - 0.5 * (about / SPUN_RAD) ** 2
    best = near_rad + float(about[int(odds.argmax())])
    fine = best + np.arange(-STEP_RAD, STEP_RAD + FINE_RAD / 2, FINE_RAD)
    odds = _found_by(views, fine, AT_PX)
    weight = np.exp(odds - odds.max())
    return float(weight @ fine / weight.sum())


def _found_by(views: Sequence[TurnPictures], turns_rad: FloatArray, near_px: float) -> FloatArray:
    """Return the log-odds (k,) of turns near each other by the edges that show.

    The same edges are in sight at all of them: which do not show tells none of them.
    """
    found = np.zeros(len(turns_rad))
    for view in views:
        found += view.log_odds(turns_rad, near_px, 0.0)
    return found


def _strongest(
    slopes: Sequence[tuple[Float32Array, Float32Array]],
    pixels: FloatArray,
    normals: FloatArray,
    near_px: float,
) -> FloatArray:
    """Return the strongest slope (n,) of any picture along normals (n, 2), near places (n, 2)."""
    steps = np.arange(-near_px, near_px + 0.25, 0.5)
    u = pixels[:, :1] + steps * normals[:, :1]
    v = pixels[:, 1:] + steps * normals[:, 1:]
    found = np.zeros(len(pixels))
    for dx, dy in slopes:
        along = sample_picture(dx, u, v) * normals[:, :1]
        along += sample_picture(dy, u, v) * normals[:, 1:]
        found = np.maximum(found, np.abs(along).max(axis=1))
    return found
