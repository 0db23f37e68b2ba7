"""Light: each lamp is switched alone and viewed by both cameras.

Identity of each lamp, by the pattern of its light, so that swapped channels are found and named;
its brightness, its response to the setting, its settling time, the evenness of a panel, and the
absence of saturated pixels.
"""

from collections.abc import Mapping
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.calibration.lamps import (
    Assignment,
    CameraBackground,
    PatternLamp,
    TooFewSamplesError,
    assign,
    evenness,
    expected_pattern,
    saturated_share,
    seconds_to_steady,
    seen_pattern,
)
from controller.cell.devices.lamps import STATION_PANEL, TABLE_PANEL
from controller.cell.services import CameraName
from controller.config import Cell
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration, LampCalibration, LampsCalibration
from controller.imaging import Camera
from controller.setup.optics import build_camera, build_lamps, light_of, panel_corners
from drivers.kinds import Camera as CameraDevice
from drivers.kinds import TimedFrame
from messages import say

from ..bench import Bench
from ..errors import StepFailedError

CAMERAS: Final[tuple[CameraName, ...]] = ("overhead", "inspection")
GLOWS_IN: Final[Mapping[str, CameraName]] = {TABLE_PANEL: "overhead", STATION_PANEL: "inspection"}
HALF: Final = 0.5  # second setting at which each lamp is measured
# least grey levels over the dark in its own camera; below, a lamp gives no light
MIN_LIGHT: Final = 3.0
MIN_AGREEMENT: Final = 0.4  # least agreement of the seen and the expected pattern, shadows included
# light at half the setting, as a share of that at the full one; a driver's own curve is in it
HALF_LIGHT: Final = (0.3, 0.7)
MAX_SATURATED: Final = 0.001  # share of the pixels
BRIGHTEST: Final = 235.0  # grey level of the brightest thousandth, at the drive a lamp is used with
MIN_DRIVE: Final = 0.05  # a lamp that is too bright below it needs another aperture or exposure
MIN_EVENNESS: Final = 0.5
MAX_SETTLE_S: Final = 1.0
REST_S: Final = 1.2  # pause between two switchings, in which a slow lamp turns dark
SHIFTS: Final = 5  # switchings of a lamp, each with another phase against the camera's frames
WATCH_S: Final = 0.8  # time for which a lamp is watched after switching
DARK_LEVEL: Final = 40.0  # mean grey level with all lamps off; above it daylight comes in


class LightStep:
    """Channel map, levels, times until steady and evenness of all lamps."""

    name = "light"
    title = "each lamp switched alone and viewed by both cameras"
    needs: tuple[str, ...] = ("devices",)
    uses: tuple[CalibrationName, ...] = ()
    makes: tuple[CalibrationName, ...] = ("lamps",)
    valid_days: int | None = 180

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Return the calibration `lamps`.

        Raises
        ------
        StepFailedError : a lamp gives no light, or makes a pattern that is none of the lamps'
        """
        await bench.permit_motion("The arm homes and parks, so that both cameras see past it.")
        await bench.home_and_park()
        dark = {camera: await _shoot(bench, camera, {}) for camera in CAMERAS}
        for camera, picture in dark.items():
            bench.evidence.measure(
                f"{camera}: grey level with all lamps off", picture.mean(), high=DARK_LEVEL
            )
        pictures = {
            lamp: {camera: await _shoot(bench, camera, {lamp: 1.0}) for camera in CAMERAS}
            for lamp in bench.cell.lamps
        }
        for lamp, by_camera in pictures.items():
            for camera, picture in by_camera.items():
                await bench.evidence.keep(f"{lamp}_{camera}", picture, f"{lamp} alone, {camera}")
        assignments = _channels(bench, pictures, dark)
        found: dict[str, LampCalibration] = {}
        for one in assignments:
            found[one.lit] = await _measure(bench, one, pictures[one.switched], dark)
        lamps = {name: found[name] for name in bench.cell.lamps}  # in the order of the cell file
        return {"lamps": LampsCalibration(**bench.header(lamps=lamps, valid_days=self.valid_days))}


async def _shoot(bench: Bench, camera: CameraName, lamps: Mapping[str, float]) -> Grey:
    if not lamps:
        # a lamp that is slow to go out is not seen in the dark picture
        await bench.imaging.all_dark()
        await bench.clock.sleep(REST_S)
    else:
        await bench.devices.lights.set(
            dict.fromkeys(bench.devices.lights.names, 0.0) | dict(lamps), settle=True
        )
        await bench.clock.sleep(MAX_SETTLE_S)
    return await bench.imaging.shoot(camera, lamps)


# ---- which is which --------------------------------------------------------------------------
def lights_of(cell: Cell) -> tuple[PatternLamp, ...]:
    """Return all lamps of a cell, as their patterns are expected."""
    lights = []
    for name in cell.lamps:
        light = light_of(cell.lamps[name], cell)
        is_panel = light.kind == "panel"
        axis = np.array(light.normal, dtype=float) if light.kind == "ring" else None
        points = np.empty((0, 3)) if is_panel else build_lamps(cell, [name])[0].points_mm
        lights.append(PatternLamp(name, points, GLOWS_IN.get(name, "") if is_panel else "", axis))
    return tuple(lights)


def surfaces_of(cell: Cell) -> tuple[CameraBackground, ...]:
    """Return the background surface of each camera: the table, and the station's panel.

    Raises
    ------
    ValueError : the station's panel names no direction
    """
    panel = cell.lamps[STATION_PANEL]
    if panel.normal is None:
        raise ValueError(f"{STATION_PANEL} has no normal")
    return (
        CameraBackground(
            "overhead", build_camera(cell.cameras.overhead), np.zeros(3), np.array([0.0, 0.0, 1.0])
        ),
        CameraBackground(
            "inspection",
            build_camera(cell.cameras.inspection),
            np.array(panel.centre, dtype=float),
            np.array(panel.normal, dtype=float),
        ),
    )


def _channels(
    bench: Bench,
    pictures: Mapping[str, Mapping[CameraName, Grey]],
    dark: Mapping[CameraName, Grey],
) -> tuple[Assignment, ...]:
    cell = bench.cell
    surfaces = surfaces_of(cell)
    expected = {light.name: expected_pattern(light, surfaces) for light in lights_of(cell)}
    unlit = [dark[camera] for camera in CAMERAS]
    seen: dict[str, FloatArray] = {}
    for lamp, by_camera in pictures.items():
        seen[lamp] = seen_pattern([by_camera[camera] for camera in CAMERAS], unlit)
        if seen[lamp].max() < MIN_LIGHT:
            raise StepFailedError(
                say(
                    "{lamp}: switched on, it gives {max:.1f} grey levels in either "
                    "picture, {min_light:g} at least are required: check its supply "
                    "and wires, and that output {analog} and relay {relay} belong to "
                    "the same lamp",
                    lamp=lamp,
                    max=seen[lamp].max(),
                    min_light=MIN_LIGHT,
                    analog=cell.lamps[lamp].analog,
                    relay=cell.lamps[lamp].relay,
                )
            )
    found = assign(seen, expected)
    for one in found:
        bench.evidence.measure(
            f"{one.switched}: agreement of its light with that of {one.lit}",
            one.agreement,
            low=MIN_AGREEMENT,
        )
    for one in found:
        if one.lit != one.switched:
            wired = cell.lamps[one.switched]
            bench.evidence.find(
                f"swapped channels: output {wired.analog} and relay {wired.relay}, assigned "
                f"to {one.switched} in the cell file, switch {one.lit} (agreement "
                f"{one.agreement:.2f}, with {one.switched} {one.own_agreement:.2f}); the "
                "calibration has them right"
            )
    return found


# ---- each lamp -------------------------------------------------------------------------------
async def _measure(
    bench: Bench,
    one: Assignment,
    pictures: Mapping[CameraName, Grey],
    dark: Mapping[CameraName, Grey],
) -> LampCalibration:
    """Measure the lamp that is lit when `one.switched` is switched."""
    cell, lamp = bench.cell, one.lit
    camera = _own_camera(lamp, pictures, dark)
    unlit = float(dark[camera].mean())
    lit, half = pictures[camera], await _shoot(bench, camera, {one.switched: HALF})
    full = float(lit.mean()) - unlit
    is_too_bright = saturated_share(lit) > MAX_SATURATED
    if is_too_bright:
        # what saturates is not measured: half the setting tells how bright the full one is
        full = (float(half.mean()) - unlit) / HALF
    bench.evidence.measure(f"{lamp}: grey levels at full setting ({camera})", full, low=MIN_LIGHT)
    if not is_too_bright:
        bench.evidence.measure(
            f"{lamp}: light at half the setting, as a share",
            (float(half.mean()) - unlit) / full,
            low=HALF_LIGHT[0],
            high=HALF_LIGHT[1],
        )
    design = cell.lamps[lamp].full_grey
    level = full / design if design is not None else 1.0
    if design is None:
        bench.evidence.find(f"{lamp}: the cell file has no full_grey, so its level counts as 1")
    else:
        bench.evidence.measure(f"{lamp}: light as a share of the nominal one", level)
    # as bright as by design, where it can be, and nowhere too bright
    brightest = float(np.percentile(half, 99.9)) / HALF
    drive = max(MIN_DRIVE, min(1.0, 1.0 / level, BRIGHTEST / brightest))
    if drive < 1.0:
        lit = await _shoot(bench, camera, {one.switched: drive})
    bench.evidence.measure(f"{lamp}: drive that it is used with", drive)
    bench.evidence.measure(
        f"{lamp}: share of saturated pixels at that drive", saturated_share(lit), high=MAX_SATURATED
    )
    uniformity = None
    if lamp in GLOWS_IN:
        optics = build_camera(getattr(cell.cameras, camera))
        inside = panel_mask(optics, panel_corners(cell, lamp))
        uniformity = evenness(lit, dark[camera], inside)
        bench.evidence.measure(
            f"{lamp}: darkest field over brightest", uniformity, low=MIN_EVENNESS
        )
    settle_s = await _time_steady(bench, one.switched, camera, unlit, drive)
    if settle_s is not None:
        bench.evidence.measure(
            f"{lamp}: settling time after it was switched on", settle_s, "s", high=MAX_SETTLE_S
        )
    channels = cell.lamps[one.switched]
    return LampCalibration(
        analog=channels.analog,
        relay=channels.relay,
        level=level,
        drive=drive,
        settle_s=settle_s or 0.0,
        uniformity=uniformity,
    )


def _own_camera(
    lamp: str, pictures: Mapping[CameraName, Grey], dark: Mapping[CameraName, Grey]
) -> CameraName:
    """Return the camera that receives most of a lamp's light."""
    if lamp in GLOWS_IN:
        return GLOWS_IN[lamp]
    return max(CAMERAS, key=lambda name: float(pictures[name].mean()) - float(dark[name].mean()))


def panel_mask(camera: Camera, corners_mm: FloatArray) -> BoolArray:
    """Return the mask (height, width) of a panel in the picture, drawn in slightly from its edges.

    Parameters
    ----------
    camera : rough pose of the camera
    corners_mm : (4, 3) corners of the panel in the world, in order round it
    """
    middle = corners_mm.mean(axis=0)
    inner = middle + 0.9 * (corners_mm - middle)  # the camera may stand some mm and degrees off
    width, height = camera.size_px
    mask = np.zeros((height, width), np.uint8)
    cv2.fillConvexPoly(mask, np.rint(camera.project(inner)).astype(np.int32), 1)
    return mask.astype(bool)


async def _time_steady(
    bench: Bench, lamp: str, camera: CameraName, dark_level: float, drive: float
) -> float | None:
    """Return the time from a lamp's order to steady light [s]; None if nothing dates frames.

    Switches it several times, each time with another phase against the frames, so that a slow
    camera can time a fast lamp.

    Parameters
    ----------
    bench : the cell
    lamp : name that is switched
    camera : camera that sees most of its light
    dark_level : mean grey level of its picture with all lamps off
    drive : setting that it is switched to
    """
    device: CameraDevice = getattr(bench.devices, camera)
    period_s = 1.0 / getattr(bench.cell.cameras, camera).fps
    everything = dict.fromkeys(bench.devices.lights.names, 0.0)
    delays, light = [], []
    await device.resume()
    try:
        for shift in range(SHIFTS):
            await bench.devices.lights.all_off()
            await bench.clock.sleep(REST_S + shift * period_s / SHIFTS)
            lit_s = await bench.devices.lights.set(everything | {lamp: drive})
            after_s = lit_s
            while after_s < lit_s + WATCH_S:
                frame = await device.frame_after(after_s)
                if not isinstance(frame, TimedFrame):
                    bench.evidence.find(
                        f"{camera}: its frames have no time stamps: {lamp} is not timed"
                    )
                    return None
                delays.append(frame.earliest_light_s - lit_s)
                light.append(frame.image.mean() * 255.0 / frame.white - dark_level)
                after_s = frame.timestamp_s
    finally:
        await device.pause()
    try:
        return seconds_to_steady(np.array(delays), np.array(light))
    except TooFewSamplesError as error:
        raise StepFailedError(
            say("{lamp}: {error}; check its driver", lamp=lamp, error=error)
        ) from error
