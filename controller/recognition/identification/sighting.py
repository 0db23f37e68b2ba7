"""Recognition's answers, with the intermediate results that explain them."""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import transform
from messages import key, say

from ..fitting import FreeTurn, longest_missing, twist
from ..library import Candidate, Library, LibraryPart, place_of
from ..segmentation import Region, Segmentation
from .decide import Decision, has_other_inside
from .hypotheses import Hypothesis
from .scene import TableScene

TIPPED_RAD: Final = np.radians(20.0)  # stable poses of a part are farther apart


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
    free_turn : axis about which the pictures leave its turn open; None if they show it, or if the
        part is round
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
    free_turn: FreeTurn | None = None

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

    def turned(self, turn_rad: float) -> "Sighting":
        """Return the sighting of a part at another turn about the vertical.

        It turns about its free axis, where it has one, else about its centre of mass.

        Parameters
        ----------
        turn_rad : further turn, anticlockwise from above
        """
        assert self.T_world_part is not None
        place_mm = about_mm = np.array([self.x_mm, self.y_mm, 0.0])
        if (free := self.upright_turn) is not None:
            about_mm = transform(self.T_world_part, free.through_mm[None])[0]
        about = twist(np.array([0.0, 0.0, turn_rad]), np.zeros(3), about_mm)
        x_mm, y_mm, _ = transform(about, place_mm[None])[0].tolist()
        return replace(
            self,
            x_mm=x_mm,
            y_mm=y_mm,
            theta_rad=(self.theta_rad + turn_rad + np.pi) % (2 * np.pi) - np.pi,
            T_world_part=about @ self.T_world_part,
        )

    def laid(self, T_world_part: FloatArray) -> "Sighting":
        """Return the sighting of a part that was set down in a pose (4, 4).

        Unchanged where the pictures show its turn, or where it has tipped over since.

        Parameters
        ----------
        T_world_part : (4, 4) pose in which it was set down, to some degrees
        """
        free = self.upright_turn
        if free is None or self.T_world_part is None:
            return self
        off = T_world_part[:3, :3] @ self.T_world_part[:3, :3].T
        if off[2, 2] < np.cos(TIPPED_RAD):
            return self
        guess = self.turned(float(np.arctan2(off[1, 0] - off[0, 1], off[0, 0] + off[1, 1])))
        return replace(guess, free_turn=replace(free, is_shown=True))

    @property
    def upright_turn(self) -> FreeTurn | None:
        """The free turn of a part that stands on its end, which is one about the vertical."""
        free, T_world_part = self.free_turn, self.T_world_part
        if free is None or T_world_part is None or not free.is_vertical(T_world_part):
            return None
        return free

    @property
    def is_turn_free(self) -> bool:
        """True if its turn about the vertical is a guess: it stands on its end."""
        return self.upright_turn is not None

    @property
    def is_roll_free(self) -> bool:
        """True if its turn about its own axis is a guess: it lies on its side."""
        return self.free_turn is not None and not self.is_turn_free

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


Seen = tuple[Sighting, Trace]


def known(
    decision: Decision,
    best: Hypothesis,
    region: Region,
    area_mm2: float,
    library: Library,
) -> Sighting:
    """Return the sighting of the part that was decided for.

    Parameters
    ----------
    decision, best : decision on the thing, and its best hypothesis
    region : as it was cut out
    area_mm2 : its area on the table
    library : library of the hypotheses
    """
    entry = library.entries[best.part]
    return Sighting(
        part=entry.name,
        pose_index=best.pose,
        R=entry.pose(best.pose).R,
        x_mm=float(best.place_mm[0]),
        y_mm=float(best.place_mm[1]),
        theta_rad=best.theta_rad,
        T_world_part=best.fit.T_world_part,
        score=decision.score,
        covariance=_covariance(best, entry),
        ambiguous_with=tuple(
            Alternative(library.entries[h.part].name, h.pose, h.theta_rad, h.fit.T_world_part)
            for h in decision.rivals
        ),
        area_mm2=area_mm2,
        box_px=region.box_px,
        residual_px=best.fit.sigma_px,
        free_turn=best.free_turn,
    )


def _covariance(best: Hypothesis, entry: LibraryPart) -> FloatArray:
    """Return the fit's covariance; a free turn is unknown, and that of a round part, too."""
    covariance = best.fit.covariance.copy()
    free, T_world_part = best.free_turn, best.fit.T_world_part
    is_free = free is not None and free.is_vertical(T_world_part)
    if is_free or len(entry.turns_of(best.pose)) == 0:
        covariance[2, :], covariance[:, 2] = 0.0, 0.0
        covariance[2, 2] = np.pi**2 / 3  # any turn is as likely
    return covariance


def unknown(
    region: Region, scene: TableScene, area_mm2: float, score: float, reason: str
) -> Sighting:
    """Return the sighting of an object that is none of the parts.

    Parameters
    ----------
    region : as it was cut out
    scene : its picture's camera
    area_mm2 : its area on the table
    score : probability that it is none of them
    reason : why it is unknown, in words
    """
    x0, y0, x1, y1 = region.box_px
    v, u = np.nonzero(region.mask)
    centre = (
        np.array([[x0 + u.mean(), y0 + v.mean()]])
        if len(u)
        else np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
    )
    ground = scene.camera.on_plane(centre)[0]
    return Sighting(
        part=None,
        pose_index=-1,
        R=None,
        x_mm=float(ground[0]),
        y_mm=float(ground[1]),
        theta_rad=0.0,
        T_world_part=None,
        score=score,
        covariance=None,
        ambiguous_with=(),
        area_mm2=area_mm2,
        box_px=region.box_px,
        residual_px=float("inf"),
        reason=reason,
    )


def why_not(decision: Decision, library: Library, *, is_backlit: bool) -> str:
    """Return the reason of a refusal: what came nearest, and what speaks against it.

    Parameters
    ----------
    decision : without a best hypothesis
    library : names the parts
    is_backlit : the outline is known whole, so that an edge of it can be missed
    """
    h = decision.nearest
    if h is None:
        return key("none of the known parts has a silhouette of this size and shape")
    name = library.entries[h.part].name
    if has_other_inside(h):
        return say(
            "none of the known parts: nearest is {name}, but an edge of "
            "{unexplained_mm:.0f} mm is seen where it has none",
            name=name,
            unexplained_mm=h.evidence.unexplained_mm,
        )
    nearest = say(
        "none of the known parts: nearest is {name}, of whose edges "
        "{outline_percent:.0f} % are in the picture and which explains "
        "{explained_percent:.0f} % of what is seen",
        name=name,
        outline_percent=100 * h.evidence.outline,
        explained_percent=100 * h.evidence.explained,
    )
    missing = longest_missing(h.fit) if is_backlit else None
    if missing is None:
        return nearest
    length_mm, (x_mm, y_mm, _) = missing
    return say(
        "{nearest}; the longest edge that is not there would be {length_mm:.0f} mm about x "
        "{x_mm:.0f}, y {y_mm:.0f} mm",
        nearest=nearest,
        length_mm=length_mm,
        x_mm=float(x_mm),
        y_mm=float(y_mm),
    )
