"""Directions from which to look at a part, and the samples that each shows.

Directions are unit vectors in the part frame from its centre of mass to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import SurfaceSamples


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """Candidate directions (v, 3) and, for square views, the face each is square to (else -1)."""

    vectors: FloatArray
    square_to: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityTable:
    """Directions and the samples that each shows of the bare part, with evidence on the rest.

    Attributes
    ----------
    directions : square ones first, then the even sphere, then those added for hard spots
    visible : (v, n) bool
    best_incidence_rad : (n,) the squarest at which any camera place sees a sample past the part,
        resolution and sharpness aside; pi/2 where none does
    blocker : (n,) the face that stands before the squarest look at a sample, -1 if none does
    too_coarse, blurred : (n,) bool, not visible though the sight line is free at an incidence
        allowed: pixels too few for the millimetre, or out of the depth of field
    """

    directions: Directions
    visible: BoolArray
    best_incidence_rad: FloatArray
    blocker: IntArray
    too_coarse: BoolArray
    blurred: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class BoreOpenings:
    """What a view has to show of a part's bores: light through them, or the floor's edge.

    Attributes
    ----------
    faces : (e,) id of the wall that each element belongs to: a sector of a through bore's rim, or
        all of a blind bore's floor
    needed : (e,) number of places that a view has to show of it
    element : (k,) number below e of the element of each place
    points_mm : (k, 3) place just inside the wall, CAD frame
    axes : (k, 3) unit, out of the mouth, of a place above a floor; 0 for one inside a rim
    """

    faces: IntArray
    needed: IntArray
    element: IntArray
    points_mm: FloatArray
    axes: FloatArray

    @property
    def is_floor(self) -> BoolArray:
        """Mask (k,) of the places above floors."""
        return np.asarray(self.axes.any(axis=1))

    def only(self, places: BoolArray) -> BoreOpenings:
        """Return the openings with some of their places (k,) alone; elements keep their numbers."""
        return replace(
            self,
            element=self.element[places],
            points_mm=self.points_mm[places],
            axes=self.axes[places],
        )


@dataclass(frozen=True, slots=True, eq=False)
class HiddenEvidence:
    """Samples, of n, that the bare part hides in all directions, with the evidence.

    Attributes
    ----------
    is_hidden : (n,) bool
    best_incidence_rad, blocker, too_coarse, blurred : (n,) as in `VisibilityTable`
    """

    is_hidden: BoolArray
    best_incidence_rad: FloatArray
    blocker: IntArray
    too_coarse: BoolArray
    blurred: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """The points by which coverage is counted; views are chosen by others (ADR 57).

    Attributes
    ----------
    samples : m of them
    probes : other points, as dense, that some direction shows: by these it is found what chosen
        views leave blind, and further ones are chosen
    nearest : (m,) the sample that views are chosen by which is nearest, on the same face
    of_chosen : (n,) the reverse: the point nearest to each of those samples
    evidence : evidence on the points that no direction shows
    """

    samples: SurfaceSamples
    probes: SurfaceSamples
    nearest: IntArray
    of_chosen: IntArray
    evidence: HiddenEvidence
