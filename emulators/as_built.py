"""The cell as really installed: its differences from its drawing, drawn from a seed.

The bounds are those of a cell that was set up with a tape measure and a spirit level. Only the
emulated world and, for benchmarks, its control port know what was drawn; clients have to measure.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from emulators.grippers import JawErrors
from emulators.lighting_modbus import LampCharacter
from emulators.umi_scara import COUNTS_PER_DEG, ArmErrors
from emulators.world import CameraLayout, LampLayout, Layout, TrayLayout
from emulators.world.arms import MadeShape, UmiShape
from emulators.world.chain import TCP
from emulators.world.layout import ArmShape
from emulators.world.poses import invert, rotation_about

Array = NDArray[np.float64]
T = TypeVar("T")

CAMERA_MM: Final = 5.0
CAMERA_DEG: Final = 1.0
FOCAL: Final = 0.01
CENTRE_PX: Final = 8.0
BLUR_PX: Final = (0.6, 1.1)
SENSITIVITY: Final = 0.15
DISTORTION: Final = (0.03, 0.03, 0.0005, 0.0005, 0.01)  # k1 k2 p1 p2 k3
BASE_MM: Final = 3.0
BASE_DEG: Final = 0.5
LINK_MM: Final = 0.3
# of an arm other than the RTX: at six links, some 1 mm at the tool, as an arm has whose maker's
# calibration of it is not used
LINK_DEG: Final = 0.03
ZERO_DEG: Final = 0.5
ZED_ZERO_MM: Final = 0.5
PLAY_DEG: Final = (0.1, 0.3)
COUPLING: Final = 0.01
SAG_MM: Final = (0.2, 0.8)
TOOL_MM: Final = 0.5
PAD_MM: Final = 0.5
STROKE: Final = 0.01
FIXED_GRIPPER_MM: Final = 4.0
FIXED_GRIPPER_DEG: Final = 1.0
TRAY_MM: Final = 5.0
LEVEL: Final = 0.20
PANEL_DROP: Final = (0.05, 0.20)
PANEL_SLOPE: Final = 0.05
SLOW_RAMP_S: Final = 0.25
PART_MM: Final = 0.1
TABLE_TILT_DEG: Final = 0.2
_TURNING: Final = ("shoulder_rad", "elbow_rad", "yaw_rad", "pitch_rad", "roll_rad")


@dataclass(frozen=True, slots=True, eq=False)
class AsBuilt:
    """One installation.

    Attributes
    ----------
    layout : the cell file's, with everything where it really is
    arm : differences of a UMI RTX from its description; of another arm, those of its jaws
    lamps : response of each lamp to its orders
    oversize_mm : oversize of the longest edge of every part
    tilt_rad : tilt of the table against all else, about x and y
    fixed_jaws : error of the fixed gripper's opening against its reading
    """

    layout: Layout
    arm: ArmErrors
    lamps: Mapping[str, LampCharacter]
    oversize_mm: float
    tilt_rad: tuple[float, float]
    fixed_jaws: JawErrors = field(default_factory=JawErrors)

    def truth(self) -> dict[str, Any]:
        """Return the true parameters to compare a calibration with, as plain values."""
        layout = self.layout
        return {
            "cameras": {
                name: {
                    "focal_px": one.focal_px,
                    "centre_px": list(one.centre_px),
                    "distortion": one.distortion.tolist(),
                    "T_world_cam": one.T_world_cam.tolist(),
                    "blur_px": one.blur_px,
                    "sensitivity": one.sensitivity,
                }
                for name, one in layout.cameras.items()
            },
            "arm": {
                "T_world_base": layout.arm.T_world_base.tolist(),
                **_arm_truth(layout.arm.shape, self.arm),
            },
            "fixed_gripper": {
                "T_world_tcp": layout.fixed_gripper.T_world_tcp.tolist(),
                "opening_zero_mm": self.fixed_jaws.wider_mm,
                "opening_scale": self.fixed_jaws.stretch,
            },
            "trays": {one.name: one.centre_mm.tolist() for one in layout.trays},
            "lamps": {
                name: {
                    "full_level": self.lamps[name].full_level,
                    "ramp_s": self.lamps[name].ramp_s,
                    "drop": one.drop,
                    "slope": list(one.slope),
                }
                for name, one in layout.lamps.items()
            },
            "oversize_mm": self.oversize_mm,
            "tilt_rad": list(self.tilt_rad),
        }


def as_drawn(layout: Layout) -> AsBuilt:
    """Return the installation that matches its cell file exactly."""
    lamps = {name: LampCharacter() for name in layout.lamps}
    return AsBuilt(layout, ArmErrors(), lamps, 0.0, (0.0, 0.0))


def draw_as_built(layout: Layout, seed: int) -> AsBuilt:
    """Return an installation that differs from its cell file as a real one does.

    Parameters
    ----------
    layout : layout of the cell file
    seed : decides all differences; the same seed builds the same cell
    """
    draw = _Draw(seed)
    tilt_rad = tuple(float(x) for x in draw.ball(math.radians(TABLE_TILT_DEG), 2))
    tilt = _turned((*tilt_rad, 0.0))
    # the table is the world's plane z = 0, so all else is tilted against it
    middle = np.append((layout.drop_low_mm + layout.drop_high_mm) / 2.0, 0.0)
    T_tilt = np.eye(4)
    T_tilt[:3, :3], T_tilt[:3, 3] = tilt, middle - tilt @ middle
    arm, fixed = layout.arm, layout.fixed_gripper
    T_world_base = T_tilt @ draw.moved(arm.T_world_base, BASE_MM, BASE_DEG)
    built_arm = replace(
        arm,
        T_world_base=T_world_base,
        T_world_column=T_world_base @ invert(arm.T_world_base),
        shape=_shape(arm.shape, draw),
    )
    slow = draw.one_of(sorted(layout.lamps))
    return AsBuilt(
        layout=replace(
            layout,
            cameras={name: _camera(one, draw, T_tilt) for name, one in layout.cameras.items()},
            arm=built_arm,
            fixed_gripper=replace(
                fixed,
                T_world_tcp=T_tilt
                @ draw.moved(fixed.T_world_tcp, FIXED_GRIPPER_MM, FIXED_GRIPPER_DEG),
            ),
            trays=tuple(_tray(one, draw) for one in layout.trays),
            lamps={name: _lamp(one, draw) for name, one in layout.lamps.items()},
        ),
        arm=_arm_errors(draw),
        lamps={
            name: LampCharacter(
                full_level=1.0 + draw.within(LEVEL),
                ramp_s=SLOW_RAMP_S if name == slow else LampCharacter().ramp_s,
            )
            for name in layout.lamps
        },
        oversize_mm=PART_MM * draw.one_of((-1.0, 1.0)),
        tilt_rad=(tilt_rad[0], tilt_rad[1]),
        fixed_jaws=JawErrors(draw.within(PAD_MM), 1.0 + draw.within(STROKE)),
    )


class _Draw:
    """Draws differences, each evenly within its bound."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 0xA5B])

    def within(self, bound: float) -> float:
        return float(self._rng.uniform(-bound, bound))

    def between(self, ends: tuple[float, float]) -> float:
        return float(self._rng.uniform(*ends))

    def one_of(self, choices: Sequence[T]) -> T:
        return choices[int(self._rng.integers(len(choices)))]

    def ball(self, radius: float, dimension: int = 3) -> Array:
        """Return a vector evenly in the ball of a radius."""
        direction = self._rng.standard_normal(dimension)
        share = self._rng.uniform() ** (1.0 / dimension)
        vector: Array = direction / np.linalg.norm(direction) * radius * share
        return vector

    def moved(self, T: Array, by_mm: float, by_deg: float) -> Array:
        """Return a pose moved by up to a limit, and turned about its own origin."""
        moved = T.copy()
        moved[:3, :3] = _turned(self.ball(math.radians(by_deg))) @ T[:3, :3]
        moved[:3, 3] += self.ball(by_mm)
        return moved


def _turned(vector_rad: Any) -> Array:  # noqa: ANN401  (three numbers)
    vector = np.asarray(vector_rad, dtype=float)
    angle = float(np.linalg.norm(vector))
    return np.eye(3) if angle == 0.0 else rotation_about(vector, angle)


def _shape(shape: ArmShape, draw: _Draw) -> ArmShape:
    """Return an arm as it was made; a UMI RTX differs in what its calibration can find."""
    if isinstance(shape, UmiShape):
        return replace(
            shape,
            upper_mm=shape.upper_mm + draw.within(LINK_MM),
            fore_mm=shape.fore_mm + draw.within(LINK_MM),
            tool_mm=shape.tool_mm + draw.within(TOOL_MM),
            tool_off_mm=(draw.within(TOOL_MM), draw.within(TOOL_MM)),
        )
    links = []
    for link in shape.chain.links:
        by_mm = TOOL_MM if link.name == TCP else LINK_MM
        links.append(replace(link, T_on_link=draw.moved(link.T_on_link, by_mm, LINK_DEG)))
    return MadeShape(replace(shape.chain, links=tuple(links)))


def _arm_truth(shape: ArmShape, errors: ArmErrors) -> dict[str, Any]:
    """Return the true figures of an arm beyond where its base is, as plain values."""
    if not isinstance(shape, UmiShape):
        links = {link.name: link.T_on_link.tolist() for link in shape.chain.links}
        return {"links": links, "jaw_zero_mm": errors.jaw_zero_mm}
    return {
        "upper_mm": shape.upper_mm,
        "fore_mm": shape.fore_mm,
        "tool_mm": shape.tool_mm,
        "tool_off_mm": list(shape.tool_off_mm),
        "zero_rad": dict(errors.zero_rad),
        "zed_zero_mm": errors.zed_zero_mm,
        "jaw_zero_mm": errors.jaw_zero_mm,
        "play_counts": {axis.value: play for axis, play in errors.play_counts.items()},
        "yaw_per_elbow": errors.yaw_per_elbow,
        "sag_mm": errors.sag_mm,
    }


def _camera(camera: CameraLayout, draw: _Draw, T_tilt: Array) -> CameraLayout:
    cx_px, cy_px = camera.centre_px
    return replace(
        camera,
        focal_px=camera.focal_px * (1.0 + draw.within(FOCAL)),
        centre_px=(cx_px + draw.within(CENTRE_PX), cy_px + draw.within(CENTRE_PX)),
        distortion=camera.distortion + np.array([draw.within(bound) for bound in DISTORTION]),
        T_world_cam=T_tilt @ draw.moved(camera.T_world_cam, CAMERA_MM, CAMERA_DEG),
        blur_px=draw.between(BLUR_PX),
        sensitivity=1.0 + draw.within(SENSITIVITY),
    )


def _tray(tray: TrayLayout, draw: _Draw) -> TrayLayout:
    return replace(tray, centre_mm=tray.centre_mm + draw.ball(TRAY_MM, 2))


def _lamp(lamp: LampLayout, draw: _Draw) -> LampLayout:
    drop, slope = draw.between(PANEL_DROP), draw.ball(PANEL_SLOPE, 2)
    return replace(lamp, drop=drop, slope=(float(slope[0]), float(slope[1])))


def _arm_errors(draw: _Draw) -> ArmErrors:
    return ArmErrors(
        zero_rad={name: math.radians(draw.within(ZERO_DEG)) for name in _TURNING},
        zed_zero_mm=draw.within(ZED_ZERO_MM),
        jaw_zero_mm=draw.within(PAD_MM),
        play_counts={
            axis: per_deg * draw.between(PLAY_DEG) for axis, per_deg in COUNTS_PER_DEG.items()
        },
        yaw_per_elbow=0.5 * draw.within(COUPLING),
        sag_mm=draw.between(SAG_MM),
    )
