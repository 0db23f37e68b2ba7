"""Places: trays and table, touched; and the obstacles that the arm could touch.

No camera sees the trays. The arm is brought above their corners, a person sets its finger tips
down, and the calibrated arm reads their positions.
"""

from collections.abc import Mapping
from typing import Final, Literal

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.places import (
    CORNERS,
    Corner,
    CornerTouch,
    aim_uncertainty,
    fit_plane,
    locate_tray,
    opposite,
    play_uncertainty_mm,
)
from controller.cell.operator import Choice
from controller.config import Cell
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration, Residual, TraysCalibration
from controller.planning.model import Tray
from controller.planning.motion import Scene
from controller.setup.measured_arm import measured_arm
from messages import key, say

from ..bench import Bench
from ..errors import DeclinedError, StepFailedError
from ..fingers import close_the_fingers, path_above, set_down
from ..person import STOP

TrayName = Literal["accept", "reject", "quarantine"]
TRAYS: Final[tuple[TrayName, ...]] = ("accept", "reject", "quarantine")
GUIDED_MM: Final = 0.3  # accuracy of fingertips set down by a person, along either axis
MAX_OFF_MM: Final = 20.0  # largest distance from the cell file; beyond it was another corner
MAX_APART_MM: Final = 2.0  # largest difference of two corners' distance from the tray's size
MAX_FLOOR_MM: Final = 2.0  # parts are let go 3 mm above the floor
MAX_TABLE_MM: Final = 1.5
MAX_TILT_DEG: Final = 0.5
INSET_MM: Final = 15.0  # distance of the places from the border of the drop area


class TraysStep:
    """The trays' middles, the table plane, and whether the obstacles were looked over."""

    name = "trays"
    title = "positions of trays and table, touched by the arm; obstacles in its reach"
    needs: tuple[str, ...] = ("arm",)
    uses: tuple[CalibrationName, ...] = ("arm",)
    makes: tuple[CalibrationName, ...] = ("trays",)
    valid_days: int | None = 180

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Touch corners of each tray and the table; return the trays' calibration.

        Raises
        ------
        StepFailedError : a corner is out of reach, or is not where a tray could be
        DeclinedError : a person ended it
        DeviceError : a device does not answer or does not get there
        """
        await _look_over_obstacles(bench)
        await bench.permit_motion(
            "The arm homes, then goes above the corners of the trays and above the table; "
            "there its motors release, and somebody lowers the finger tips."
        )
        await bench.home_and_park()
        await close_the_fingers(bench)
        toucher = _Toucher(bench)
        centres: dict[TrayName, tuple[float, float]] = {}
        u_mm, apart_mm = 0.0, 0.0
        for name in TRAYS:
            tray = bench.layout.trays[name]
            touches = await toucher.corners(name, tray)
            fit = locate_tray(tray.size_mm, touches)
            off_mm = float(np.linalg.norm(fit.centre_mm - tray.centre_mm))
            own_mm = toucher.uncertainty_mm(len(touches))
            measure = bench.evidence.measure
            measure(
                f"tray {name}: from its position in the cell file", off_mm, "mm", uncertainty=own_mm
            )
            measure(
                f"tray {name}: its corners from its size", fit.off_mm, "mm", high=MAX_APART_MM / 2
            )
            measure(
                f"tray {name}: its floor over the table plane",
                fit.height_mm,
                "mm",
                low=-MAX_FLOOR_MM,
                high=MAX_FLOOR_MM,
            )
            x_mm, y_mm = fit.centre_mm
            centres[name] = (round(float(x_mm), 3), round(float(y_mm), 3))
            u_mm, apart_mm = max(u_mm, own_mm), max(apart_mm, fit.off_mm)
        plane = fit_plane(await toucher.table())
        bench.evidence.measure(
            "table: its height in the drop area",
            plane.height_mm,
            "mm",
            low=-MAX_TABLE_MM,
            high=MAX_TABLE_MM,
            uncertainty=bench.layout.place_u_mm,
        )
        bench.evidence.measure(
            "table: its tilt against the board at its mark",
            plane.tilt_deg,
            "deg",
            high=MAX_TILT_DEG,
        )
        bench.evidence.measure(
            "table: touches from one plane", plane.rms_mm, "mm", high=MAX_TABLE_MM
        )
        await bench.go(bench.layout.park_q, "going to the park")
        return {
            "trays": TraysCalibration(
                **bench.header(
                    valid_days=self.valid_days,
                    residual=Residual(value=round(apart_mm, 4), unit="mm", limit=MAX_APART_MM / 2),
                ),
                centres=centres,
                u_mm=round(u_mm, 4),
            )
        }


async def _look_over_obstacles(bench: Bench) -> None:
    """Have a person compare the obstacles in the cell with those in its file.

    Raises
    ------
    DeclinedError : it is not so
    """
    listed = obstacle_words(bench.cell)
    choices = (
        Choice(
            "drawn",
            ("each stands as drawn by eye, and nothing else stands there; none was measured"),
        ),
        Choice("measured", "each was measured in this cell, and nothing else stands there"),
        Choice(STOP, "end this step, correct the cell file"),
    )
    answer = await bench.person.choose(
        "obstacles",
        "Paths are proven free only of the obstacles in the cell file. Compare it with the "
        f"cell: {'; '.join(listed)}. How are their positions known?",
        choices,
    )
    if answer == STOP:
        raise DeclinedError(key("ended by a person: the cell file does not list all obstacles"))
    how = "measured in this cell" if answer == "measured" else "as drawn, checked by eye"
    bench.evidence.find(f"{len(listed)} obstacles, {how}: {'; '.join(listed)}")


def obstacle_words(cell: Cell) -> tuple[str, ...]:
    """Return the obstacles that paths are proven free of, each with its place in the world."""
    boxes = {"post of the fixed gripper": cell.fixed_gripper.post, **cell.obstacles}
    if cell.chute is not None:
        boxes |= {f"chute {name}": box for name, box in cell.chute.walls.items()}
    words = [
        f"{name.replace('_', ' ')} x {x0:g} to {x1:g}, y {y0:g} to {y1:g}, z {z0:g} to {z1:g} mm"
        for name, (x0, x1, y0, y1, z0, z1) in boxes.items()
    ]
    if cell.chute is not None:
        for name, plate in cell.chute.plates.items():
            x, y, z = plate.corner
            words.append(f"chute {name} from its corner x {x:g} y {y:g} z {z:g} mm")
    return tuple(words)


class _Toucher:
    """Touches place after place, and keeps the uncertainty that gear play leaves."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._scene: Scene = bench.scene()
        self._count = 0
        self._play_mm = 0.0

    def uncertainty_mm(self, count: int) -> float:
        """Return the standard uncertainty of a place after a number of touches."""
        arm_mm = self._bench.layout.place_u_mm
        return float(np.hypot(np.hypot(aim_uncertainty(GUIDED_MM, count), self._play_mm), arm_mm))

    async def corners(self, name: TrayName, tray: Tray) -> list[CornerTouch]:
        """Touch two corners of a tray, opposite ones if the arm reaches both."""
        self._play_mm = 0.0
        touches: list[CornerTouch] = []
        # where the arm is not folded first: it can home from there if the step is broken off
        for is_folded in (False, True):
            left = [one for one in CORNERS if one not in [touch.corner for touch in touches]]
            while left and len(touches) < 2:
                # across the tray next, if the arm gets there
                across = [opposite(touch.corner) for touch in touches]
                left = sorted(left, key=across.__contains__)
                found = await self._corner(name, tray, left.pop(), is_folded=is_folded)
                if found is not None:
                    touches.append(found)
        if not touches:
            x_mm, y_mm = tray.centre_mm
            raise StepFailedError(
                say(
                    "tray {name}: the arm reaches none of its corners with its fingers "
                    "down (its middle is at x {x_mm:.0f} y {y_mm:.0f} mm by the cell "
                    "file); move the tray, and correct the cell file",
                    name=name,
                    x_mm=x_mm,
                    y_mm=y_mm,
                )
            )
        if len(touches) == 1:
            self._bench.evidence.find(f"tray {name}: the arm reaches only one corner")
        return touches

    async def _corner(
        self, name: TrayName, tray: Tray, corner: Corner, *, is_folded: bool
    ) -> CornerTouch | None:
        place = _place(tray, corner)
        words = " and ".join(
            f"{'larger' if side > 0 else 'smaller'} {axis}"
            for side, axis in zip(corner, "xy", strict=True)
        )
        text = (
            f"Guide the finger tips by hand into the corner of the tray {name} at {words}, onto "
            f"its floor (by the cell file x {place[0]:.0f} y {place[1]:.0f} mm). Are they there?"
        )
        at_mm = await self._touch(
            f"tray {name}, corner at x {place[0]:.0f} y {place[1]:.0f} mm",
            place,
            text,
            {"tray": name, "corner": list(corner)},
            is_folded=is_folded,
        )
        if at_mm is None:
            return None
        off_mm = float(np.linalg.norm(at_mm[:2] - place[:2]))
        if off_mm > MAX_OFF_MM:
            raise StepFailedError(
                say(
                    "tray {name}: its corner was touched {off_mm:.0f} mm from its "
                    "position in the cell file, {max_off_mm:.0f} are allowed: it was "
                    "another corner, or the tray stands elsewhere; move it there or "
                    "correct the cell file",
                    name=name,
                    off_mm=off_mm,
                    max_off_mm=MAX_OFF_MM,
                )
            )
        return CornerTouch(corner, at_mm)

    async def table(self) -> FloatArray:
        """Touch the table at up to four places of the drop area; return them (n, 3)."""
        area = self._bench.cell.table.drop_area
        found = []
        for x_mm in (area.x[0] + INSET_MM, area.x[1] - INSET_MM):
            for y_mm in (area.y[0] + INSET_MM, area.y[1] - INSET_MM):
                name = f"table at x {x_mm:.0f} y {y_mm:.0f} mm"
                text = f"Lower the finger tips by hand onto the {name}. Are they there?"
                place = np.array([x_mm, y_mm, 0.0])
                at_mm = await self._touch(name, place, text, {}, is_folded=True)
                if at_mm is None:
                    self._bench.evidence.find(f"{name}: out of the arm's reach, left out")
                    continue
                found.append(at_mm)
        if len(found) < 3:
            raise StepFailedError(
                say(
                    "the arm reaches {found_count} places of the drop area with its "
                    "fingers down, three are required; check the pose of the arm",
                    found_count=len(found),
                )
            )
        return np.array(found)

    async def _touch(
        self,
        name: str,
        place: FloatArray,
        text: str,
        where: Mapping[str, object],
        *,
        is_folded: bool = False,
    ) -> FloatArray | None:
        """Touch a place (3,); return the fingertips' point, None if the arm does not reach it."""
        bench = self._bench
        path = await path_above(bench, self._scene, place, name, is_folded=is_folded)
        if not path:
            return None
        self._count += 1
        order = {"do": "guide", "seed": self._count, **where}
        at_mm, q = await set_down(bench, path, name, text, order)
        play_deg = bench.cell.devices.arm.settings.get("play_deg", {})
        motors = measured_arm(bench.layout).motors
        play_mm = play_uncertainty_mm(bench.layout, q, play_deg, motors)
        self._play_mm = max(self._play_mm, play_mm)
        return at_mm


def _place(tray: Tray, corner: Corner) -> FloatArray:
    return np.append(
        np.array(tray.centre_mm) + np.array(corner) * np.array(tray.size_mm) / 2.0, 0.0
    )
