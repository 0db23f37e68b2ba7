"""Recognition's answers, with the intermediate results that explain them."""

from dataclasses import dataclass, field, replace

import numpy as np

from controller.arrays import FloatArray

from ..library import Candidate, Library, place_of
from ..segmentation import Region, Segmentation
from .hypotheses import Hypothesis


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another hypothesis about a sighting that the pictures do not rule out.

    Attributes
    ----------
    T_world_part : (4, 4) pose of the part under this hypothesis
    """

    part: str
    pose_index: int
    theta_rad: float
    T_world_part: FloatArray = field(compare=False)


@dataclass(frozen=True, eq=False, slots=True)
class Sighting:
    """One object on the table.

    Attributes
    ----------
    part : name, None for an object that is none of the library's
    pose_index : stable pose, -1 if unknown
    R : (3, 3) CAD -> upright
    x_mm, y_mm, theta_rad : planar pose; the centre of mass stands over (x, y)
    T_world_part : (4, 4), None if unknown; with the small tilt of table and part, if one was found
    score : probability that part and pose are right, 0..1; of an unknown object, that it is one
    sigma_mm, sigma_rad : standard deviations of the place (the larger of x and y) and of the turn
    covariance : (3, 3) covariance of x [mm], y [mm], theta [rad], None if unknown
    ambiguous_with : hypotheses the pictures cannot tell from this one
    area_mm2, box_px : area and box of the object in the picture (x0, y0, x1, y1)
    residual_px : robust standard deviation of the edges from their predictions
    reason : reason why it is unknown
    free_share : share of its outline by which it was recognised; the rest other objects cover, or
        it lies outside the picture or the backlit area. Parts of one backlit cluster lie beside
        each other on the table, none on another
    lies_on : numbers of the picture's sightings that it lies on, from 0; its ``T_world_part`` then
        has the tilt it leans by and is no pose of a part at rest on the table
    is_covered : True if another object lies on it
    touching_count : other objects that it is one cluster with
    is_cut : True if it lies partly outside the picture or the backlit area
    """

    part: str | None
    pose_index: int
    R: FloatArray | None
    x_mm: float
    y_mm: float
    theta_rad: float
    T_world_part: FloatArray | None
    score: float
    covariance: FloatArray | None
    ambiguous_with: tuple[Alternative, ...]
    area_mm2: float
    box_px: tuple[int, int, int, int]
    residual_px: float
    reason: str = ""
    free_share: float = 1.0
    touching_count: int = 0
    is_cut: bool = False
    lies_on: tuple[int, ...] = ()
    is_covered: bool = False

    def read_as(self, name: str, library: Library) -> "Sighting":
        """Return the sighting as that part, with this hypothesis as the alternative.

        Unchanged where it is that part already, or where the pictures rule that part out.

        Parameters
        ----------
        name : name of the part that is expected
        library : library used for the recognition
        """
        own = next((a for a in self.ambiguous_with if a.part == name), None)
        if self.part is None or self.part == name or own is None:
            return self
        assert self.T_world_part is not None
        entry = next(e for e in library.entries if e.name == name)
        x_mm, y_mm = place_of(entry, own.T_world_part).tolist()
        this = Alternative(self.part, self.pose_index, self.theta_rad, self.T_world_part)
        return replace(
            self,
            part=name,
            pose_index=own.pose_index,
            R=entry.pose(own.pose_index).R,
            x_mm=x_mm,
            y_mm=y_mm,
            theta_rad=own.theta_rad,
            T_world_part=own.T_world_part,
            ambiguous_with=(this, *(a for a in self.ambiguous_with if a is not own)),
        )

    @property
    def sigma_mm(self) -> float:
        """Standard deviation of the place, the larger of x and y; inf if unknown."""
        if self.covariance is None:
            return float("inf")
        return float(np.sqrt(max(self.covariance[0, 0], self.covariance[1, 1])))

    @property
    def sigma_rad(self) -> float:
        """Standard deviation of the turn; inf if unknown."""
        return float("inf") if self.covariance is None else float(np.sqrt(self.covariance[2, 2]))


@dataclass(frozen=True, eq=False, slots=True)
class Trace:
    """Record of one sighting's recognition, stage by stage.

    Attributes
    ----------
    region : region cut out
    candidates : candidates by silhouette, best overlap first
    hypotheses : fitted hypotheses, best first
    """

    region: Region
    candidates: tuple[Candidate, ...]
    hypotheses: tuple[Hypothesis, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Recognition:
    """All sightings in a picture.

    Attributes
    ----------
    sightings : largest object first
    traces : one for each sighting
    segmentation : segmentation of the picture, with remarks for the operator
    """

    sightings: tuple[Sighting, ...]
    traces: tuple[Trace, ...]
    segmentation: Segmentation
