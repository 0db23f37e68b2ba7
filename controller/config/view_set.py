"""SET.json, `cellctl.views/1`: stored pictures of one part, with the poses of part and lamps.

Millimetres and degrees; files are named relative to the set's own file (docs/inspect.md).
"""

import base64
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, model_validator

from controller.arrays import BoolArray
from controller.yaml_text import WrongKeyError, YamlText

from .cell import MAX_SIZE_PX, AccuracySection, LightSection
from .characteristics import GivenSection
from .errors import ConfigError
from .files import parse_json, read_text
from .recipe import Recipe, Unit
from .yaml_models import DIALECT, Section

SCHEMA: Final = "cellctl.views/1"
MAX_SET_BYTES: Final = 16 * 2**20  # a view takes 3 KB
MAX_VIEW_COUNT: Final = 1000
SQUARE: Final = 1e-3  # axes of a pose written with four digits are square by this
JSON_DIALECT: Final = replace(
    DIALECT,
    words={
        **DIALECT.words,
        "model_type": 'must be an object, as in {"key": value}',
        "dict_type": 'must be an object, as in {"name": value}',
        "string_type": "must be text in quotes",
    },
)
MIN_CODE_MM2: Final = 1e-4  # area of a code, below which its corners are in line
MAX_NUMBER: Final = 1e9  # largest number of a matrix: beyond any focal length or position in a cell

Rows = tuple[tuple[float, ...], ...]


def _matrix(row_count: int, column_count: int) -> BeforeValidator:
    """Return the check that a value is a matrix of this size, of finite numbers."""

    def check(value: Any) -> Rows:  # noqa: ANN401 - whatever the file has there
        expected = f"must be {row_count} rows of {column_count} numbers"
        if not _is_list(value, row_count):
            raise ValueError(f"{expected}, found {value!r:.60}")
        for row in value:
            if not _is_list(row, column_count) or not all(map(_is_finite, row)):
                raise ValueError(f"{expected}, found the row {row!r:.60}")
        return tuple(tuple(float(number) for number in row) for row in value)

    return BeforeValidator(check)


def _is_list(value: object, count: int) -> bool:
    return isinstance(value, list | tuple) and len(value) == count


def _is_finite(number: object) -> bool:
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    return abs(number) < MAX_NUMBER


def _rigid(rows: Rows) -> Rows:
    """Return a pose; raise ValueError if it is none."""
    T = np.array(rows)
    R = T[:3, :3]
    if not np.array_equal(T[3], [0, 0, 0, 1]):
        raise ValueError(f"must be a pose: its last row is [0, 0, 0, 1], not {rows[3]}")
    off = float(np.abs(R.T @ R - np.eye(3)).max())
    if off > SQUARE:
        raise ValueError(
            f"must be a pose: its axes are of length 1 and square, these are off by {off:.2g}; "
            "write six digits"
        )
    if np.linalg.det(R) < 0:
        raise ValueError("must be a pose: its axes are left-handed, as in a mirror")
    return rows


def _square(rows: Rows) -> Rows:
    """Return the corners of a code; raise ValueError if they are in line."""
    first, second, _, fourth = np.array(rows)
    if np.linalg.norm(np.cross(second - first, fourth - first)) < MIN_CODE_MM2:
        raise ValueError("must be four corners in turn, not in line")
    return rows


def _camera_matrix(rows: Rows) -> Rows:
    """Return a camera matrix; raise ValueError if it is none."""
    (fx, skew, _), (lower, fy, _), last = rows
    if not (fx > 0 and fy > 0 and skew == lower == 0 and last == (0, 0, 1)):
        raise ValueError("must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0")
    return rows


def _unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a direction; raise ValueError if it is not of length 1."""
    off = abs(float(np.linalg.norm(vector)) - 1.0)
    if off > SQUARE:
        raise ValueError(f"must be a direction of length 1, this is off by {off:.2g}")
    return vector


PoseRows = Annotated[Rows, _matrix(4, 4), AfterValidator(_rigid)]
CodeRows = Annotated[Rows, _matrix(4, 3), AfterValidator(_square)]
Name = Annotated[str, Field(min_length=1, max_length=80)]
Number = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Point = tuple[Number, Number, Number]
Direction = Annotated[Point, AfterValidator(_unit)]
HalfEdge = Annotated[float, Field(gt=0, le=5000)]


def packed(mask: BoolArray) -> str:
    """Return a mask (n,) as text: eight samples a byte, bytes in base 64."""
    return base64.b64encode(np.packbits(mask).tobytes()).decode("ascii")


def unpacked(text: str, count: int) -> BoolArray:
    """Return the mask (n,) that `packed` packed.

    Raises
    ------
    ValueError : the text is not a mask of so many samples
    """
    try:
        bits = np.frombuffer(base64.b64decode(text, validate=True), dtype=np.uint8)
    except ValueError as error:
        raise ValueError(f"is no base 64 ({error})") from error
    if len(bits) != (count + 7) // 8:
        raise ValueError(f"has {8 * len(bits)} samples, `sample_count` is {count}")
    return np.unpackbits(bits, count=count).astype(bool)


class SetCamera(Section):
    """The calibrated camera of a set, or of one view.

    Attributes
    ----------
    size_px : width and height
    K : camera matrix
    distortion : k1, k2, p1, p2, k3 of OpenCV's model
    T_world_cam : pose of the camera
    """

    size_px: tuple[
        Annotated[int, Field(ge=16, le=MAX_SIZE_PX)], Annotated[int, Field(ge=16, le=MAX_SIZE_PX)]
    ]
    K: Annotated[Rows, _matrix(3, 3), AfterValidator(_camera_matrix)]
    distortion: tuple[float, float, float, float, float]
    T_world_cam: PoseRows


class SetBox(Section):
    """A box of the gripper: pose of its centre, half edges.

    Attributes
    ----------
    T : pose of its centre in the world
    half_mm : half extents along its axes
    """

    T: PoseRows
    half_mm: tuple[HalfEdge, HalfEdge, HalfEdge]


class SetTurn(Section):
    """An axis about which the part's turn is a guess, in the CAD frame.

    Attributes
    ----------
    axis : unit vector along it
    through_mm : a point on it
    same_deg : turns about it that leave the part as it is, 0 among them
    is_shown : a view has shown the turn, roughly
    guess_number : of the guess; views of an earlier one were expected at a turn that was wrong
    """

    axis: Direction
    through_mm: Point
    same_deg: Annotated[tuple[float, ...], Field(min_length=1)] = (0.0,)
    is_shown: bool = False
    guess_number: Annotated[int, Field(ge=0)] = 0


class SetView(Section):
    """One view.

    Attributes
    ----------
    id : id of the view; results name it
    T_world_part : expected pose of the part
    prior_mm, prior_deg : standard deviations of that
    gripper_boxes : boxes of the gripper that may appear in the picture
    pictures : files by lamp, exactly one of them before a panel
    grasp : number of the grasp (default: by the boxes' poses at the part)
    camera : camera of the view (default: the set's)
    is_hold_measured : the expected pose was measured in an earlier view
    planned : samples of the surface that the view was to show, as `packed` writes them
    only_planned : no other sample counts
    free_turn : axis about which the turn of the expected pose is a guess (default: none)
    """

    id: Name
    T_world_part: PoseRows
    prior_mm: float = Field(1.5, gt=0, le=50)
    prior_deg: float = Field(1.7, gt=0, le=45)
    gripper_boxes: tuple[SetBox, ...] = ()
    pictures: dict[Name, Path]
    grasp: int | None = Field(None, ge=0)
    camera: SetCamera | None = None
    is_hold_measured: bool = False
    planned: str | None = None
    only_planned: bool = False
    free_turn: SetTurn | None = None


class SetCalibration(Section):
    """A cell's calibrations that were no longer valid, in sentences; empty if all were.

    Attributes
    ----------
    stale : one sentence for each that was stale
    why_not_verified : reason why its verification did not count
    """

    stale: Annotated[tuple[str, ...], Field(max_length=20)] = ()
    why_not_verified: str = ""


class ViewSetFile(Section):
    """Stored pictures of one part.

    Attributes
    ----------
    schema_ : name and version of the form
    part : CAD file
    unit : unit of a CAD file that names none; all other lengths are in mm
    camera : camera of all views that name none
    lamps : by name; panels, rings and spots
    views : in the order taken
    characteristics : characteristics to be measured (default: those that follow from the CAD file)
    recipe : recipe with the limits to judge by, if no other is given
    unseen : reason by face id why the plan could not show all of it
    sample_count : number of samples of the surface, for `planned`
    accuracy : uncertainty of measurements with this camera
    calibration : calibrations of the cell that no longer counted when the pictures were taken
    learned : file of what good parts look like, which decides on surfaces (default: none)
    codes_mm : corners of codes on the part, in turn, in the CAD frame; nothing is compared there
        (default: none)
    """

    schema_: Literal["cellctl.views/1"] = Field(alias="schema")
    part: Path
    unit: Unit = "mm"
    camera: SetCamera
    lamps: dict[Name, LightSection]
    views: Annotated[tuple[SetView, ...], Field(max_length=MAX_VIEW_COUNT)]
    characteristics: Annotated[tuple[GivenSection, ...], Field(max_length=2000)] | None = None
    recipe: Recipe | None = None
    unseen: dict[int, str] = Field(default_factory=dict)
    sample_count: int | None = Field(None, ge=1)
    accuracy: AccuracySection = AccuracySection()
    calibration: SetCalibration = SetCalibration()
    learned: Path | None = None
    codes_mm: Annotated[tuple[CodeRows, ...], Field(max_length=20)] | None = None

    @model_validator(mode="after")
    def _rings_have_a_radius(self) -> "ViewSetFile":
        for name, light in self.lamps.items():
            if light.kind == "ring" and light.radius is None:
                raise WrongKeyError(("lamps", name, "radius"), "a ring needs its radius")
        return self

    @model_validator(mode="after")
    def _views_fit(self) -> "ViewSetFile":
        ids: dict[str, int] = {}
        for i, view in enumerate(self.views):
            first = ids.setdefault(view.id, i)
            if first != i:
                raise WrongKeyError(
                    ("views", i, "id"), f"is {view.id!r}, which is also the id of `views.{first}`"
                )
            unknown = [name for name in view.pictures if name not in self.lamps]
            if unknown:
                raise WrongKeyError(
                    ("views", i, "pictures", unknown[0]),
                    f"no such lamp; `lamps` has {', '.join(self.lamps) or 'none'}",
                )
            if self.panel_of(view) is None:
                raise WrongKeyError(
                    ("views", i, "pictures"),
                    "exactly one picture before a lamp of kind panel is required, found "
                    f"{len(self._panels(view))}",
                )
        return self

    @model_validator(mode="after")
    def _masks_fit(self) -> "ViewSetFile":
        for i, view in enumerate(self.views):
            if view.planned is None:
                continue
            try:
                unpacked(view.planned, self.sample_count or 0)
            except ValueError as error:
                raise WrongKeyError(("views", i, "planned"), str(error)) from error
        return self

    def camera_of(self, view: SetView) -> SetCamera:
        """Return the camera that took a view."""
        return view.camera or self.camera

    def panel_of(self, view: SetView) -> str | None:
        """Return the name of the panel before which a view was taken; None if not exactly one."""
        panels = self._panels(view)
        return panels[0] if len(panels) == 1 else None

    def _panels(self, view: SetView) -> list[str]:
        return [name for name in view.pictures if self.lamps[name].kind == "panel"]


def load_view_set(path: Path) -> ViewSetFile:
    """Return a set of views, with file names relative to the working directory.

    Raises
    ------
    ConfigError : unreadable, not JSON, unknown or missing keys, values that cannot be; the message
        names file and key
    """
    return parse_view_set(path, read_text(path, "a set of views", MAX_SET_BYTES))


def parse_view_set(path: Path, text: str) -> ViewSetFile:
    """Return a set of views, with file names relative to the working directory.

    Parameters
    ----------
    path : path of its file, for messages and as the place that files are relative to
    text : its content

    Raises
    ------
    ConfigError : not JSON, unknown or missing keys, values that cannot be; the message names file
        and key
    """
    tree = _tree(path, text)
    try:
        found = ViewSetFile.model_validate(tree)
    except ValidationError as error:
        keys = YamlText(path, JSON_DIALECT, tree, {})
        raise ConfigError(keys.problems(ViewSetFile, [dict(e) for e in error.errors()])) from error
    views = tuple(
        view.model_copy(
            update={"pictures": {lamp: path.parent / file for lamp, file in view.pictures.items()}}
        )
        for view in found.views
    )
    learned = found.learned and path.parent / found.learned
    return found.model_copy(
        update={"part": path.parent / found.part, "views": views, "learned": learned}
    )


def _tree(path: Path, text: str) -> dict[str, Any]:
    """Return the object in a JSON text."""
    if not text.strip():
        raise ConfigError(f"{path}: is empty; a set of views ({SCHEMA}) is expected")
    tree = parse_json(text, path, f"a set of views ({SCHEMA})")
    if not isinstance(tree, dict):
        raise ConfigError(f"{path}: is no JSON object; a set of views ({SCHEMA}) is expected")
    if tree.get("schema") != SCHEMA:
        raise ConfigError(
            f'{path}: `schema`: "{SCHEMA}" is expected, found {tree.get("schema")!r:.60}; '
            "is it the right file?"
        )
    return tree
