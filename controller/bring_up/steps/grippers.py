"""Grippers: their openings against gauges, their holds, and the fixed one's place.

The fixed gripper is out of every camera's sight. It holds the plate, and the arm, which is
calibrated, touches both faces of the plate with its fingers' tips.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, radians
from pathlib import Path
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.grippers import (
    FixedGripperFit,
    Touch,
    TouchError,
    TouchNoise,
    locate_fixed_gripper,
)
from controller.calibration.target import BoardSection, load_board
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration, FixedGripperCalibration, Residual
from messages import key, say

from ..bench import Bench
from ..boards import PlateInJaws, as_handed, board_file
from ..errors import StepFailedError
from ..gauges.holding import shake
from ..gauges.taking import (
    give_back_from_arm,
    give_back_from_fixed,
    require_fixed_holds,
    take_in_arm,
    take_in_fixed,
)
from ..gauges.touching import Column, Fingers, columns, plate_in_fixed, scene_about

PLATE_FORCE_N: Final = 40.0  # fixed gripper's force on the plate, above the push of any touch
FORCE_MIN_N: Final = 20.0  # least force that a recipe may ask for (`grasp.force_n`)
ZERO_MM: Final = 2.0  # largest offset of an opening at reading 0
SCALE: Final = 0.05
ARM_OFF_MM: Final = 0.5  # largest error of the calibrated arm's jaws on a gauge
# standard deviations after placing by tape measure and spirit level, within 4 mm and 1 degree
OFF_FILE: Final = np.array([radians(1.0) / 5**0.5] * 3 + [4.0 / 5**0.5] * 3)
TOUCH_MM: Final = 0.2
TOUCH_MIN_MM: Final = 0.05
OPENING_MM: Final = 0.1
COLUMNS_MIN: Final = 3
TOUCHES_MIN: Final = 12
MAX_RMS_MM: Final = 0.4
MAX_U_MM: Final = 0.4
MAX_U_DEG: Final = 0.25
MAX_AGAIN_MM: Final = 0.4


@dataclass(frozen=True, slots=True)
class OpeningFit:
    """A true opening as a function of its reading: ``zero + scale * reading``."""

    zero_mm: float
    scale: float

    @classmethod
    def of(cls, thickness_mm: Sequence[float], reading_mm: Sequence[float]) -> "OpeningFit":
        """Return the opening scale and zero that follow from two gauges and their readings.

        Raises
        ------
        StepFailedError : both read alike
        """
        wide_mm = reading_mm[1] - reading_mm[0]
        if abs(wide_mm) < 1.0:
            raise StepFailedError(
                say(
                    "gauges of {thickness_mm:g} and {other_mm:g} mm read "
                    "{reading_mm:.1f} and {other_reading_mm:.1f} mm: two gauges of "
                    "different thickness are required",
                    thickness_mm=thickness_mm[0],
                    other_mm=thickness_mm[1],
                    reading_mm=reading_mm[0],
                    other_reading_mm=reading_mm[1],
                )
            )
        scale = (thickness_mm[1] - thickness_mm[0]) / wide_mm
        return cls(thickness_mm[0] - scale * reading_mm[0], scale)


class GrippersStep:
    """Openings of both grippers, their hold, and the pose of the fixed one."""

    name = "grippers"
    title = "openings and holds of both grippers, and the pose of the fixed one"
    needs: tuple[str, ...] = ("arm",)
    uses: tuple[CalibrationName, ...] = ("overhead", "inspection", "arm", "lamps")
    makes: tuple[CalibrationName, ...] = ("fixed_gripper",)
    valid_days: int | None = 90

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Measure openings, try the hold, touch the plate, and return the fixed gripper's place.

        Raises
        ------
        StepFailedError : a gauge is not between the jaws, or touches contradict each other
        DeclinedError : a person ended it
        DeviceError : a device does not answer or does not get there
        """
        gauges = [_Gauge.of(bench, name) for name in ("paddle", "gauge")]
        plate = gauges[0]
        gripper = bench.devices.gripper
        await bench.permit_motion(
            "The fixed gripper opens and closes. The arm homes, shakes a plate, and then touches "
            "it in the fixed gripper, slowly."
        )
        await bench.move_jaws("the fixed gripper is activated and may move", gripper.activate)
        await bench.home_and_park()
        await _arm_openings(bench, gauges)
        await _hold(bench, plate)
        openings = await _fixed_openings(bench, gauges)
        fit, off_mm = await _touched(bench, plate, openings)
        return {"fixed_gripper": _calibration(bench, fit, openings, off_mm)}


@dataclass(frozen=True, slots=True)
class _Gauge:
    board: BoardSection
    file: Path

    @classmethod
    def of(cls, bench: Bench, name: str) -> "_Gauge":
        file = board_file(bench, name)
        return cls(load_board(file), file)


# ---- openings and hold ---------------------------------------------------------------------------
async def _arm_openings(bench: Bench, gauges: Sequence[_Gauge]) -> None:
    read = []
    for seed, one in enumerate(gauges, 1):
        read.append(await take_in_arm(bench, one.board, one.file, seed))
        await give_back_from_arm(bench, one.board, one.file)
        bench.evidence.measure(
            f"arm gripper on the gauge of {one.board.thickness_mm:g} mm, off by",
            read[-1] - one.board.thickness_mm,
            "mm",
            low=-ARM_OFF_MM,
            high=ARM_OFF_MM,
        )
    _measure(
        bench, key("arm gripper"), OpeningFit.of([one.board.thickness_mm for one in gauges], read)
    )


async def _hold(bench: Bench, plate: _Gauge) -> None:
    held = PlateInJaws(bench, as_handed(bench, plate.board), plate.file)
    await held.take(seed=3, force=round(FORCE_MIN_N))
    try:
        await shake(bench, held)
    except StepFailedError:
        await held.give_back()
        raise
    await held.give_back()


async def _fixed_openings(bench: Bench, gauges: Sequence[_Gauge]) -> OpeningFit:
    read = []
    for seed, one in enumerate(gauges, 4):
        read.append(await take_in_fixed(bench, one.board, one.file, seed, PLATE_FORCE_N))
        await give_back_from_fixed(bench, one.file)
    found = OpeningFit.of([one.board.thickness_mm for one in gauges], read)
    _measure(bench, key("fixed gripper"), found)
    return found


def _measure(bench: Bench, which: str, found: OpeningFit) -> None:
    bench.evidence.measure(
        f"{which}: true opening at reading 0", found.zero_mm, "mm", low=-ZERO_MM, high=ZERO_MM
    )
    bench.evidence.measure(
        f"{which}: scale of its opening", found.scale, low=1 - SCALE, high=1 + SCALE
    )


# ---- touches -------------------------------------------------------------------------------------
async def _touched(
    bench: Bench, plate: _Gauge, openings: OpeningFit
) -> tuple[FixedGripperFit, float]:
    """Return the fixed gripper as touched, and the distance of a repeated touch from the first."""
    board = plate.board
    width_mm, height_mm, thickness_mm = board.plate_mm
    end_mm = height_mm - board.bare_mm / 2.0 - bench.layout.arm_gripper.pad_centre_mm
    box = plate_in_fixed(thickness_mm, (height_mm, width_mm), end_mm)
    scene = scene_about(bench.layout, box, thickness_mm)
    ways = columns(bench.layout, scene, end_mm)
    if len(ways) < COLUMNS_MIN:
        raise StepFailedError(
            say(
                "the arm reaches the plate in the fixed gripper along {ways_count} "
                "free paths, {columns_min} are required; clear the space before "
                "the fixed gripper, or check its pose and the obstacles in the "
                "cell file",
                ways_count=len(ways),
                columns_min=COLUMNS_MIN,
            )
        )
    await take_in_fixed(bench, board, plate.file, 6, PLATE_FORCE_N)
    try:
        touches, off_mm = await _touches(bench, Fingers(bench, scene, thickness_mm), ways)
        await require_fixed_holds(bench)
    except StepFailedError:
        await _leave(bench, scene)
        await give_back_from_fixed(bench, plate.file)
        raise
    await _leave(bench, scene)
    await give_back_from_fixed(bench, plate.file)
    try:
        fit = locate_fixed_gripper(
            np.asarray(bench.layout.T_world_fixed_tcp, dtype=np.float64),
            OFF_FILE,
            touches,
            thickness_mm=thickness_mm,
            finger_width_mm=bench.layout.arm_gripper.finger_width_mm,
            noise=_noise(bench),
        )
    except TouchError as error:
        raise StepFailedError(str(error)) from error
    return fit, off_mm


async def _touches(
    bench: Bench, fingers: Fingers, ways: Sequence[Column]
) -> tuple[list[Touch], float]:
    found: list[Touch] = []
    for number, way in enumerate(ways, 1):
        bench.evidence.show(f"touching the plate, {number} of {len(ways)}")
        found += await fingers.touch_along(way, f"touch {number}")
    again = await fingers.touch_again(ways[0], "touch again")
    first = next((one for one in found if one.name == "touch 1.1"), None)
    if again is None or first is None or len(found) < TOUCHES_MIN:
        raise StepFailedError(
            say(
                "{found_count} touches of one finger alone, {touches_min} are "
                "required: the fixed gripper is farther from its pose in the cell "
                "file than the arm allows for; measure its pose anew and enter it "
                "in the cell file",
                found_count=len(found),
                touches_min=TOUCHES_MIN,
            )
        )
    return found, (again.opening_mm - first.opening_mm) / 2.0


async def _leave(bench: Bench, scene: Any) -> None:  # noqa: ANN401
    for waypoint in await bench.path_to(bench.layout.park_q, scene, "leaving the fixed gripper"):
        await bench.motion.follow((waypoint,))


def _noise(bench: Bench) -> TouchNoise:
    u = bench.cell.arm.uncertainty
    # its position is uncertain to all sides, and one of them counts
    return TouchNoise(
        TOUCH_MM, TOUCH_MIN_MM, OPENING_MM, u.position_mm / 3**0.5, radians(u.angle_deg) / 2**0.5
    )


# ---- what was found ------------------------------------------------------------------------------
def _calibration(
    bench: Bench, fit: FixedGripperFit, openings: OpeningFit, off_mm: float
) -> FixedGripperCalibration:
    evidence = bench.evidence
    d = np.linalg.inv(bench.layout.T_world_fixed_tcp) @ fit.T_world_tcp
    evidence.measure("jaws' plane, offset from the file", float(d[1, 3]), "mm")
    turned = degrees(float(np.arccos(np.clip(d[1, 1], -1.0, 1.0))))
    evidence.measure("tilt of the jaws' plane against the file", turned, "deg")
    evidence.measure("touches, from the faces of the plate", fit.rms_mm, "mm", high=MAX_RMS_MM)
    evidence.measure("jaws' plane, uncertainty along its normal", fit.u_mm, "mm", high=MAX_U_MM)
    u_deg = degrees(fit.u_rad)
    evidence.measure("jaws' plane, uncertainty of its tilt", u_deg, "deg", high=MAX_U_DEG)
    evidence.measure("arm's jaws, wider than they read", fit.opening_off_mm, "mm")
    evidence.measure(
        "plate in the fixed jaws, moved by the touches",
        off_mm,
        "mm",
        low=-MAX_AGAIN_MM,
        high=MAX_AGAIN_MM,
    )
    evidence.find(
        f"the touches determine {', '.join(fit.observed)} of the fixed gripper's pose; "
        f"{', '.join(fit.held)} are kept from the file"
    )
    return FixedGripperCalibration(
        **bench.header(residual=Residual(value=round(fit.rms_mm, 4), unit="mm", limit=MAX_RMS_MM)),
        T_world_tcp=_matrix(fit.T_world_tcp),
        opening_zero_mm=round(openings.zero_mm, 4),
        opening_scale=round(openings.scale, 6),
        u_mm=fit.u_mm,
        u_deg=u_deg,
        observed=fit.observed,
        held=fit.held,
    )


def _matrix(T: FloatArray) -> Any:  # noqa: ANN401  (rows of numbers)
    return tuple(tuple(float(v) for v in row) for row in T)
