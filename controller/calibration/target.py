"""A board's own file, and target.json: the board, its pose in each picture, the world."""

from math import radians
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from controller.config import Section, load_yaml

from .camera import (
    Charuco,
    Chessboard,
    PlacedBoard,
    Target,
    WorldFrame,
    charuco_board,
)

Corners = Annotated[int, Field(ge=3, le=100)]


def _placed(text: str) -> str:
    """Return "flat" or "tilted"; raise ValueError for any other text."""
    if text not in {member.value for member in PlacedBoard}:
        raise ValueError(f"a board is placed flat (on the table) or tilted, not {text!r:.40}")
    return text


class PictureSection(Section):
    """A picture of the board."""

    image: str = Field(min_length=1)
    placed: Annotated[str, AfterValidator(_placed)]
    note: str = ""


class WorldSection(Section):
    """The pose in the world of the board in one flat picture.

    Attributes
    ----------
    origin_mm : origin of the board's frame; its z is the height of the print over the table, for
        every flat board
    """

    image: str
    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    x_axis_angle_deg: float = Field(0.0, ge=-360, le=360)
    note: str = ""

    def build(self) -> WorldFrame:
        """Return the frame in mm and rad."""
        return WorldFrame(self.image, self.origin_mm, radians(self.x_axis_angle_deg))


class BoardSection(Section):
    """A chessboard (inner_corners) or a ChArUco board (squares, marker_mm, dictionary).

    Attributes
    ----------
    first_marker : id of the marker at the print's upper left; the others follow row by row
    thickness_mm : thickness of the plate, whose upper face bears the print
    margin_mm : white around the print
    bare_mm : height of bare plate beyond the margin at the print's lower side, for the grasp
    back_first_marker : the same on the other face, whose print is the front's, seen from behind
        with the same side down; None: the other face is bare
    board_frame, note : for people
    """

    inner_corners: tuple[Corners, Corners] | None = None
    squares: tuple[Corners, Corners] | None = None
    square_mm: float = Field(gt=0, le=1000)
    marker_mm: float | None = Field(None, gt=0)
    dictionary: str | None = None
    legacy_pattern: bool = False
    first_marker: int = Field(0, ge=0)
    thickness_mm: float = Field(5.0, gt=0, le=100)
    margin_mm: float = Field(10.0, ge=0, le=500)
    bare_mm: float = Field(0.0, ge=0, le=500)
    back_first_marker: int | None = Field(None, ge=0)
    board_frame: str = ""
    note: str = ""

    @model_validator(mode="after")
    def _one_kind_of_board(self) -> "BoardSection":
        charuco = {
            "squares": self.squares,
            "marker_mm": self.marker_mm,
            "dictionary": self.dictionary,
            "back_first_marker": self.back_first_marker,
        }
        if self.inner_corners is not None:
            given = [key for key, value in charuco.items() if value is not None]
            if given or self.legacy_pattern:
                key = (given or ["legacy_pattern"])[0]
                raise ValueError(
                    f"`inner_corners` describes a chessboard and `{key}` a ChArUco board; keep one"
                )
            return self
        del charuco["back_first_marker"]
        lacking = [f"`{key}`" for key, value in charuco.items() if value is None]
        if len(lacking) == len(charuco):
            raise ValueError(
                "either `inner_corners` of a chessboard or `squares`, `marker_mm` and "
                "`dictionary` of a ChArUco board are required"
            )
        if lacking:
            raise ValueError(f"a ChArUco board needs {' and '.join(lacking)} as well")
        if self.marker_mm is not None and self.marker_mm >= self.square_mm:
            raise ValueError(
                f"`marker_mm` {self.marker_mm:g} must be less than `square_mm` {self.square_mm:g}"
            )
        charuco_board(self._charuco(self.first_marker))  # names an unknown dictionary
        if self.back_first_marker is not None:
            charuco_board(self._charuco(self.back_first_marker))
        return self

    def build(self) -> Target:
        """Return the board of the front."""
        if self.inner_corners is not None:
            return Chessboard(self.inner_corners, self.square_mm)
        return self._charuco(self.first_marker)

    def build_back(self) -> Charuco | None:
        """Return the board on the other face; None for a bare one."""
        if self.back_first_marker is None:
            return None
        return self._charuco(self.back_first_marker)

    @property
    def print_mm(self) -> tuple[float, float]:
        """Width and height of the print, all of its squares [mm]."""
        if self.inner_corners is not None:
            columns, rows = self.inner_corners[0] + 1, self.inner_corners[1] + 1
        else:
            columns, rows = self._charuco(self.first_marker).squares
        return columns * self.square_mm, rows * self.square_mm

    @property
    def plate_mm(self) -> tuple[float, float, float]:
        """Width, height and thickness of the plate [mm]."""
        width_mm, height_mm = self.print_mm
        both_mm = 2.0 * self.margin_mm
        return width_mm + both_mm, height_mm + both_mm + self.bare_mm, self.thickness_mm

    def _charuco(self, first_marker: int) -> Charuco:
        if self.squares is None or self.marker_mm is None or self.dictionary is None:
            raise ValueError("no ChArUco board")
        return Charuco(
            self.squares,
            self.square_mm,
            self.marker_mm,
            self.dictionary,
            self.legacy_pattern,
            first_marker,
        )


class CalibrationTarget(BoardSection):
    """A board in some pictures.

    Attributes
    ----------
    images : poses of the board in the pictures
    world : reference that fixes the world frame (default: the first flat board)
    """

    images: tuple[PictureSection, ...] = Field(min_length=1)
    world: WorldSection | None = None

    @model_validator(mode="after")
    def _pictures_fit_together(self) -> "CalibrationTarget":
        names = [picture.image for picture in self.images]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"`images` names {twice[0]} twice; remove one")
        flat = [
            picture.image for picture in self.images if picture.placed == PlacedBoard.FLAT.value
        ]
        if not flat:
            raise ValueError(
                "`images` has no flat board, so the table plane is unknown; take at least one "
                "picture with the board on the table"
            )
        if self.world is None:
            return self
        if self.world.image not in flat:
            raise ValueError(
                f"`world.image` {self.world.image} is not one of the flat ones ({', '.join(flat)})"
            )
        if not self.build().has_one_way_up:
            raise ValueError(
                "`world` needs a board that looks different after half a turn: one count of inner "
                "corners odd, the other even"
            )
        return self

    def placed(self, image: str) -> PlacedBoard:
        """Return the placement of the board in a picture of `images`."""
        return PlacedBoard(next(p.placed for p in self.images if p.image == image))

    def entry_of(self, path: Path) -> str | None:
        """Return the name in `images` that a file's name ends with, the longest of several."""
        fitting = [p.image for p in self.images if path.name.endswith(Path(p.image).name)]
        return max(fitting, key=lambda name: len(Path(name).name), default=None)


def load_target(path: Path) -> CalibrationTarget:
    """Return a calibration target, read from its file (JSON, or the same in YAML).

    Raises
    ------
    ConfigError : unreadable, not JSON, unknown or missing keys, or an impossible board
    """
    return load_yaml(path, CalibrationTarget)


def load_board(path: Path) -> BoardSection:
    """Return a board, read from a file of its own (JSON, or the same in YAML).

    Raises
    ------
    ConfigError : unreadable, not JSON, unknown or missing keys, or an impossible board
    """
    return load_yaml(path, BoardSection)
