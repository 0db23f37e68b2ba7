"""The cell file as the world reads it: the places of everything, and the lamps and cameras.

The controller reads the same file by itself; nothing of its reading is used here. Lengths stay in
mm; `matter/bodies.py` turns them into pybullet's metres.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent

from emulators.ur_arm import JOINTS as UR_JOINTS
from emulators.ur_arm import MODELS as UR_MODELS

from .arms import BODIES, UmiShape, UrShape
from .chain import Chain
from .shapes import Array, Box, PlacedBox

MM_PER_M: Final = 1000.0
_TRAY_WALL_MM: Final = 3.0  # thickness of the trays' walls
_TEXT_BYTES_MAX: Final = 1_000_000
_DEPTH_MAX: Final = 20
RING_WIDTH_MM: Final = 8.0  # width of a ring's light, unless the cell file states one
SPOT_DIAMETER_MM: Final = 40.0
PANEL_DROP: Final = 0.10  # a panel is darker at its corners by this fraction
BLUR_SIGMA_PX: Final = 0.6  # blur of the lens; a pixel's own area is in the samples already


class LayoutError(Exception):
    """The cell file cannot be emulated: names the entry and the reason."""


@dataclass(frozen=True, slots=True)
class Fingers:
    """Two straight fingers in the TCP frame: x approach, y the jaws' axis, origin between the ends.

    A finger fills x from -length to 0, z within half the width, and y from half the opening
    outwards by the thickness; its pad is the inner face's first ``pad_length_mm``.
    """

    length_mm: float
    width_mm: float
    thickness_mm: float
    pad_length_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class CameraLayout:
    """A camera; T_world_cam in OpenCV's axes: z forwards, y down, pixel (0, 0) a pixel's centre.

    Attributes
    ----------
    blur_px : standard deviation of its lens' blur
    sensitivity : sensitivity of lens and sensor, as a factor on what the nominal ones give
    """

    name: str
    width_px: int
    height_px: int
    focal_px: float
    centre_px: tuple[float, float]
    distortion: Array
    T_world_cam: Array
    exposure_s: float
    fps: float
    formats: tuple[str, ...]
    blur_px: float = BLUR_SIGMA_PX
    sensitivity: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class LampLayout:
    """A lamp: a backlight panel, a ring of light, or a spot.

    Attributes
    ----------
    analog, relay : channels of the two light modules, from 0
    kind : ``panel``, ``ring`` or ``spot``
    centre_mm : (3,) in the world
    normal, up : (3,) of a panel: where it shines to, and the direction of ``size_mm[1]``
    size_mm : size of a panel, across and along ``up``
    radius_mm, width_mm : radius and width of a ring: to the middle of its light, and how wide that
        is
    diameter_mm : diameter of a spot
    drop : fraction by which a panel is darker at its corners
    slope : fraction by which its light changes from its middle to its edge, across and along
    """

    name: str
    analog: int
    relay: int
    kind: str
    centre_mm: Array
    normal: Array
    up: Array
    size_mm: tuple[float, float]
    radius_mm: float
    width_mm: float = RING_WIDTH_MM
    diameter_mm: float = SPOT_DIAMETER_MM
    drop: float = PANEL_DROP
    slope: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class TrayLayout:
    """A tray: a floor at z = 0 with low walls.

    Attributes
    ----------
    has_nests : parts stay in it; another one is emptied before the next part comes
    """

    name: str
    centre_mm: Array
    size_mm: Array
    has_nests: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class GripperLayout:
    """One of the two grippers: boxes and fingers in its TCP frame.

    Attributes
    ----------
    T_world_tcp : pose of the fixed one; identity for the arm's, which moves
    """

    T_world_tcp: Array
    boxes: tuple[Box, ...]
    fingers: Fingers
    jaw_max_mm: float


class ArmShape(Protocol):
    """The lengths of an arm, of whatever kind."""

    @property
    def chain(self) -> Chain:
        """The arm with these lengths."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ArmLayout:
    """The arm and the gripper on it.

    Attributes
    ----------
    T_world_base : (4, 4) pose of the frame that its first link is on
    shape : its lengths, which make the chain of its links
    column : box of what does not move
    T_world_column : (4, 4) pose of the frame that the column's corners are given in: it stands on
        the arm's base, and goes where that goes
    """

    T_world_base: Array
    shape: ArmShape
    column: Box
    gripper: GripperLayout
    T_world_column: Array = field(default_factory=lambda: np.eye(4))

    @property
    def chain(self) -> Chain:
        """Its links."""
        return self.shape.chain


@dataclass(frozen=True, slots=True)
class DriverChoice:
    """The cell file's entry on the driver of an emulated device.

    Attributes
    ----------
    driver : its name, empty for the usual one
    settings : settings of the driver
    """

    driver: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The cell, in mm and rad, world frame: table plane z = 0, origin under the shoulder axis."""

    name: str
    drop_low_mm: Array
    drop_high_mm: Array
    cameras: Mapping[str, CameraLayout]
    station_mm: Array
    lamps: Mapping[str, LampLayout]
    arm: ArmLayout
    fixed_gripper: GripperLayout
    post: Box
    obstacles: tuple[Box, ...]
    chute: tuple[PlacedBox, ...]
    trays: tuple[TrayLayout, ...]
    inputs: Mapping[str, int]
    outputs: Mapping[str, int]
    drivers: Mapping[str, DriverChoice]


def read_layout(path: Path) -> Layout:
    """Return the layout of the cell that a cell file describes.

    Raises
    ------
    LayoutError : the file cannot be read, or an entry is missing or of the wrong kind
    """
    try:
        raw = load_plain(path)
    except OSError as error:
        raise LayoutError(f"{path}: {error.strerror}") from error
    except Exception as error:
        raise LayoutError(f"{path}: not YAML: {error}") from error
    if not isinstance(raw, dict):
        raise LayoutError(f"{path}: a cell file is a mapping, found {type(raw).__name__}")
    try:
        return _layout(raw)
    except KeyError as error:
        raise LayoutError(f"{path}: entry {error} is missing") from error
    except (TypeError, ValueError) as error:
        raise LayoutError(f"{path}: {error}") from error


def load_plain(path: Path) -> Any:  # noqa: ANN401  (of a file)
    """Return the content of a YAML or JSON file; a small text must not unfold into gigabytes.

    Raises
    ------
    ValueError : it is larger or nested deeper than any file of a cell, or has aliases
    """
    with path.open("rb") as file:
        data = file.read(_TEXT_BYTES_MAX + 1)
    if len(data) > _TEXT_BYTES_MAX:
        raise ValueError(f"more than {_TEXT_BYTES_MAX} bytes")
    text, depth = data.decode("utf-8"), 0
    for event in YAML(typ="safe", pure=True).parse(text):
        if isinstance(event, AliasEvent):
            raise ValueError("aliases are not read")
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if depth > _DEPTH_MAX:
            raise ValueError(f"nested deeper than {_DEPTH_MAX}")
    return YAML(typ="safe", pure=True).load(text)


def _tray_walls(trays: dict[str, Any]) -> list[Box]:
    """Return the walls of all trays that have any: four boxes round the floor of each."""
    walls = []
    for name, tray in trays.items():
        height = float(tray.get("walls_mm", 0.0))
        if height <= 0.0:
            continue
        centre, half = np.array(tray["centre"], float), np.array(tray["size"], float) / 2.0
        low, high = centre - half, centre + half
        outer_low, outer_high = low - _TRAY_WALL_MM, high + _TRAY_WALL_MM
        for side, (a, b) in enumerate(
            (
                (outer_low, np.array((low[0], outer_high[1]))),
                (np.array((high[0], outer_low[1])), outer_high),
                (np.array((low[0], outer_low[1])), np.array((high[0], low[1]))),
                (np.array((low[0], high[1])), np.array((high[0], outer_high[1]))),
            ),
            start=1,
        ):
            walls.append(Box(f"wall {side} of {name}", np.append(a, 0.0), np.append(b, height)))
    return walls


def _layout(raw: dict[str, Any]) -> Layout:
    drop, fixed = raw["table"]["drop_area"], _renamed(raw, "fixed_gripper", "fixture")
    return Layout(
        name=str(raw["name"]),
        drop_low_mm=np.array([drop["x"][0], drop["y"][0]], dtype=float),
        drop_high_mm=np.array([drop["x"][1], drop["y"][1]], dtype=float),
        cameras={name: _camera(name, one) for name, one in raw["cameras"].items()},
        station_mm=_vector(raw["station"]["position"]),
        lamps={name: _lamp(name, one) for name, one in raw["lamps"].items()},
        arm=_arm(raw["arm"], str(raw["devices"]["arm"].get("driver") or "")),
        fixed_gripper=GripperLayout(
            T_world_tcp=_pose(fixed["pose"]),
            boxes=_boxes(fixed["body"]),
            fingers=_fingers(fixed["fingers"]),
            jaw_max_mm=float(fixed["jaw_max_mm"]),
        ),
        post=_box("post", fixed["post"]),
        obstacles=(*_boxes(raw["obstacles"]), *_tray_walls(raw["trays"])),
        chute=_chute(raw.get("chute") or {}),
        trays=tuple(
            TrayLayout(
                name,
                np.array(one["centre"], float),
                np.array(one["size"], float),
                one.get("nests") is not None,
            )
            for name, one in raw["trays"].items()
        ),
        inputs={name: int(channel) for name, channel in raw["interlocks"].items()},
        outputs={name: int(channel) for name, channel in (raw.get("outputs") or {}).items()},
        drivers=_drivers(raw.get("devices") or {}),
    )


def _drivers(devices: dict[str, Any]) -> dict[str, DriverChoice]:
    """Return the drivers for emulated devices; nothing is known here of real ones."""
    return {
        name: DriverChoice(str(one.get("driver") or ""), one.get("settings") or {})
        for name, one in devices.items()
        if one.get("address") == "emulated"
    }


def _renamed(raw: dict[str, Any], name: str, old: str) -> Any:  # noqa: ANN401  (a value of the file)
    """Return the entry of a name; files may have the old name in its place."""
    if name in raw and old in raw:
        raise ValueError(f"`{old}` is the old name of `{name}`; leave one out")
    return raw[old] if old in raw else raw[name]


def _arm(raw: dict[str, Any], driver: str) -> ArmLayout:
    """Return the arm: a UMI RTX, or the one whose ``shape`` is given, by the driver's name."""
    has_shape = "shape" in raw
    if has_shape and driver not in _SHAPES:
        raise ValueError(
            f"`arm.shape` describes an arm of the driver `{driver}`, which cannot be emulated "
            f"(emulated: a UMI RTX, and the arms of {', '.join(_SHAPES)}). Give each device the "
            "address of a real one"
        )
    return ArmLayout(
        T_world_base=_pose(raw["pose"]),
        shape=_SHAPES[driver](raw["shape"]) if has_shape else _umi(raw),
        column=_box("column", raw["column"] if has_shape else raw["links"]["column"]),
        gripper=GripperLayout(
            T_world_tcp=np.eye(4),
            boxes=_boxes(_renamed(raw, "arm_gripper", "hand")),
            fingers=_fingers(raw["fingers"]),
            jaw_max_mm=float(raw["jaw_max_mm"]),
        ),
    )


def _umi(raw: dict[str, Any]) -> UmiShape:
    links = raw["links"]
    return UmiShape(
        upper_mm=float(raw["upper_mm"]),
        fore_mm=float(raw["fore_mm"]),
        tool_mm=float(raw["tool_mm"]),
        wrist_height_mm=float(raw["wrist_height_mm"]),
        carriage=_box("carriage", links["carriage"]),
        upper=_box("upper", links["upper"]),
        fore=_box("fore", links["fore"]),
    )


def _ur(raw: dict[str, Any]) -> UrShape:
    model = str(raw["model"])
    if model not in BODIES:
        raise ValueError(f"arm.shape.model: {model!r} is not emulated ({', '.join(BODIES)} are)")
    park_deg = [float(one) for one in raw["park_deg"]]
    if len(park_deg) != len(UR_JOINTS):
        raise ValueError(f"arm.shape.park_deg: {len(UR_JOINTS)} joints, found {len(park_deg)}")
    return UrShape(
        facts=UR_MODELS[model],
        body=BODIES[model],
        flange_to_tcp_mm=float(raw["flange_to_tcp_mm"]),
        jaws_rad=math.radians(float(raw.get("jaws_deg", 0.0))),
        park_q=tuple(math.radians(one) for one in park_deg),
    )


# What stands under `shape` of the cell file's section `arm`, by the name of the driver
_SHAPES: Final[Mapping[str, Callable[[dict[str, Any]], ArmShape]]] = {"ur": _ur}


def _camera(name: str, raw: dict[str, Any]) -> CameraLayout:
    width_px, height_px = raw["size_px"]
    cx_px, cy_px = raw["centre_px"]
    return CameraLayout(
        name=name,
        width_px=int(width_px),
        height_px=int(height_px),
        focal_px=float(raw["focal_px"]),
        centre_px=(float(cx_px), float(cy_px)),
        distortion=np.array(raw["distortion"], dtype=float),
        T_world_cam=_pose(raw["pose"]),
        exposure_s=float(raw["exposure_s"]),
        fps=float(raw["fps"]),
        formats=tuple(str(one) for one in raw["formats"]),
    )


def _lamp(name: str, raw: dict[str, Any]) -> LampLayout:
    kind = str(raw["kind"])
    if kind not in ("panel", "ring", "spot"):
        raise ValueError(f"lamps.{name}.kind: {kind!r} is none of panel, ring, spot")
    size = raw.get("size", [0.0, 0.0])
    return LampLayout(
        name=name,
        analog=int(raw["analog"]),
        relay=int(raw["relay"]),
        kind=kind,
        centre_mm=_vector(raw["centre"]),
        normal=_vector(raw.get("normal", [0, 0, 1])),
        up=_vector(raw.get("up", [1, 0, 0])),
        size_mm=(float(size[0]), float(size[1])),
        radius_mm=float(raw.get("radius", 0.0)),
        width_mm=float(raw.get("width", RING_WIDTH_MM)),
        diameter_mm=float(raw.get("diameter", SPOT_DIAMETER_MM)),
    )


def _fingers(raw: dict[str, Any]) -> Fingers:
    return Fingers(
        length_mm=float(raw["length_mm"]),
        width_mm=float(raw["width_mm"]),
        thickness_mm=float(raw["thickness_mm"]),
        pad_length_mm=float(raw["pad_length_mm"]),
    )


def _boxes(raw: dict[str, Any]) -> tuple[Box, ...]:
    return tuple(_box(name, one) for name, one in raw.items())


def _chute(raw: dict[str, Any]) -> tuple[PlacedBox, ...]:
    """Return plates and walls of the chute under the fixed gripper; none if there is none."""
    walls = [PlacedBox(box, np.eye(4)) for box in _boxes(raw.get("walls", {}))]
    plates = [_plate(name, one) for name, one in raw.get("plates", {}).items()]
    return tuple(
        PlacedBox(Box(f"chute {one.box.name}", one.box.low_mm, one.box.high_mm), one.T_world_box)
        for one in (*plates, *walls)
    )


def _plate(name: str, raw: dict[str, Any]) -> PlacedBox:
    """Return a plate: from its corner two edges span the face that parts slide on."""
    along, across = _vector(raw["along"]), _vector(raw["across"])
    length_mm, width_mm = float(np.linalg.norm(along)), float(np.linalg.norm(across))
    T = np.eye(4)
    T[:3, 0], T[:3, 1] = along / length_mm, across / width_mm
    T[:3, 2], T[:3, 3] = np.cross(T[:3, 0], T[:3, 1]), _vector(raw["corner"])
    low = np.array((0.0, 0.0, -float(raw["thickness_mm"])))
    return PlacedBox(Box(name, low, np.array((length_mm, width_mm, 0.0))), T)


def _box(name: str, raw: list[float]) -> Box:
    if len(raw) != 6:
        raise ValueError(f"box {name}: six numbers x0 x1 y0 y1 z0 z1, found {len(raw)}")
    corners = np.array(raw, dtype=float).reshape(3, 2)
    return Box(name, corners[:, 0], corners[:, 1])


def _vector(raw: list[float]) -> Array:
    vector = np.array(raw, dtype=float)
    if vector.shape != (3,):
        raise ValueError(f"three numbers expected, found {raw}")
    return vector


def _pose(raw: dict[str, Any]) -> Array:
    x, y = _vector(raw["x_axis"]), _vector(raw["y_axis"])
    if abs(x @ y) > 1e-9 or abs(x @ x - 1.0) > 1e-9 or abs(y @ y - 1.0) > 1e-9:
        raise ValueError(f"axes {raw['x_axis']} and {raw['y_axis']} are not of length 1 and square")
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2] = x, y, np.cross(x, y)
    T[:3, 3] = _vector(raw["position"])
    return T
