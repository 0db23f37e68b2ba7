"""The surroundings of the arm: table, fixed gripper, chute, trays."""

from itertools import combinations
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ..grippers import FingersSection, FixedJawsSection, Width
from ..yaml_models import Section, WrongKeyError
from .values import IN_MM, MAX_OFF_MM, MAX_ZERO_DEG, Box, Pose, Range, Size, Vec2, Vec3

MIN_AREA_MM = 10.0  # least side of an area in which parts lie


class Range2(Section):
    """A rectangle on the table.

    Attributes
    ----------
    x, y : range in the world, from and to
    """

    x: Range
    y: Range


class TableSection(Section):
    """The light table, and the area on it where parts can be expected.

    Attributes
    ----------
    glowing_area : area lit from below
    drop_area : area in which parts are sought and planned from
    """

    glowing_area: Range2
    drop_area: Range2

    @model_validator(mode="after")
    def _areas_hold_a_part(self) -> "TableSection":
        for name, area in (("glowing_area", self.glowing_area), ("drop_area", self.drop_area)):
            side_mm = min(area.x[1] - area.x[0], area.y[1] - area.y[0])
            if side_mm < MIN_AREA_MM:
                raise WrongKeyError((name,), f"a side of {side_mm:g} mm; {IN_MM}")
        return self


class HeldSection(Section):
    """The largest error of a pose that was not measured.

    Attributes
    ----------
    mm, deg : its position, its orientation
    """

    mm: float = Field(0.0, ge=0, le=MAX_OFF_MM)
    deg: float = Field(0.0, ge=0, le=MAX_ZERO_DEG)


class FixedGripperSection(Section):
    """The fixed second gripper.

    Attributes
    ----------
    pose : pose of its TCP: x is the approach, along y the pads open
    jaw_max_mm : its widest opening
    body : boxes in the frame of its TCP
    post : box in the world: what it is bolted to
    opening_zero_mm, opening_scale : its jaws are ``zero + scale * reported`` apart
    held : largest error of its position along its pads, if only its plane was measured
    """

    pose: Pose
    held: HeldSection = HeldSection()
    opening_zero_mm: float = Field(0.0, ge=-10, le=10)
    opening_scale: float = Field(1.0, ge=0.8, le=1.25)
    jaw_max_mm: Width
    jaws: FixedJawsSection = FixedJawsSection()
    body: dict[str, Box]
    fingers: FingersSection
    post: Box


class PlateSection(Section):
    """A plate: from its corner two edges span the face that parts slide on.

    The plate's matter is on the other side: that face looks along ``along`` x ``across``.

    Attributes
    ----------
    corner : in the world
    along, across : the two edges from it
    thickness_mm : thickness of the plate
    """

    corner: Vec3
    along: Vec3
    across: Vec3
    thickness_mm: Width

    @model_validator(mode="after")
    def _is_a_rectangle(self) -> Self:
        along, across = np.array(self.along), np.array(self.across)
        lengths = float(np.linalg.norm(along)), float(np.linalg.norm(across))
        if min(lengths) <= 0:
            raise ValueError("along and across must be longer than 0")
        if abs(along @ across) > 1e-4 * lengths[0] * lengths[1]:
            raise ValueError("along and across must be at right angles")
        return self


class ChuteSection(Section):
    """A chute that catches a part falling from the fixed gripper; the part slides onto the table.

    Attributes
    ----------
    plates : plates that the part slides on
    walls : boxes in the world that keep it on the plates, and on the table
    """

    plates: dict[str, PlateSection]
    walls: dict[str, Box] = Field(default_factory=dict)


class NestSection(Section):
    """A place for one part in a tray.

    Attributes
    ----------
    at : x, y from the tray's middle, along the world's axes
    size : room along x and y; the part's outline stays within it
    turn : angle about the vertical that parts are turned to, deg; None for any
    """

    at: Vec2
    size: Size
    turn: float | None = Field(None, ge=-360, le=360)


class NestGridSection(Section):
    """Nests side by side that share a tray evenly.

    Attributes
    ----------
    columns, rows : along x and along y
    turn : angle about the vertical that parts are turned to, deg; None for any
    """

    columns: int = Field(ge=1, le=20)
    rows: int = Field(ge=1, le=20)
    turn: float | None = Field(None, ge=-360, le=360)


class TraySection(Section):
    """A place to put parts.

    Attributes
    ----------
    centre : x, y of its middle in the world
    size : along x and y
    nests : places for one part each, filled in order and counted; None for a tray with one place
        in its middle that nobody counts: somebody empties it after each part
    walls_mm : height of the tray's walls above its floor
    """

    centre: Vec2
    size: Size
    nests: NestGridSection | Annotated[list[NestSection], Field(min_length=1)] | None = None
    walls_mm: float = Field(0.0, ge=0, le=200)

    def places(self) -> list[NestSection]:
        """Return the nests, in the order in which they are filled; none if they are not counted."""
        if not isinstance(self.nests, NestGridSection):
            return list(self.nests or [])
        grid = self.nests
        room = (self.size[0] / grid.columns, self.size[1] / grid.rows)
        return [
            NestSection(
                at=(
                    (column + 0.5) * room[0] - self.size[0] / 2,
                    (row + 0.5) * room[1] - self.size[1] / 2,
                ),
                size=room,
                turn=grid.turn,
            )
            for row in range(grid.rows)
            for column in range(grid.columns)
        ]

    @model_validator(mode="after")
    def _nests_are_within(self) -> "TraySection":
        for number, nest in enumerate(self.places(), start=1):
            for axis, name in enumerate("xy"):
                out = abs(nest.at[axis]) + (nest.size[axis] - self.size[axis]) / 2
                if out > 1e-6:
                    raise ValueError(f"nest {number} is {out:g} mm beyond the tray along {name}")
        for k, one in enumerate(self.places()):
            for number, other in enumerate(self.places()[:k], start=1):
                if _overlap(one.at, one.size, other.at, other.size):
                    raise ValueError(f"nests {number} and {k + 1} overlap")
        return self


class TraysSection(Section):
    """The trays for parts, by verdict."""

    accept: TraySection
    reject: TraySection
    quarantine: TraySection

    @model_validator(mode="after")
    def _lie_apart(self) -> "TraysSection":
        trays = {"accept": self.accept, "reject": self.reject, "quarantine": self.quarantine}
        for (name, one), (other_name, other) in combinations(trays.items(), 2):
            if _overlap(one.centre, one.size, other.centre, other.size):
                raise ValueError(
                    f"{name} and {other_name} overlap; move one, or parts of both lie together"
                )
        return self


def _overlap(centre: Vec2, size: Size, other_centre: Vec2, other_size: Size) -> bool:
    """Return True if two rectangles along x and y have an area in common."""
    gaps = [
        abs(centre[axis] - other_centre[axis]) - (size[axis] + other_size[axis]) / 2
        for axis in (0, 1)
    ]
    return max(gaps) < -1e-6
