"""Devices: identity, speed and steadiness; then each verb by its smallest safe motion.

The order is that of a first contact (docs/protocols/umi_rtx.md 10): only read; then one motor after
the other, a little and with little force; then homing axis by axis. A person confirms each.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cell.devices.interlocks import REQUIRED_SIGNALS, settled_signal
from controller.cell.devices.lamps import STATION_PANEL, TABLE_PANEL
from controller.cell.services import CameraName
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration
from drivers.errors import ArmStalledError
from drivers.kinds import (
    Camera,
    FirstContact,
    Frame,
    MotorWatchdog,
    Signal,
    Stop,
    SupplySense,
    TimedFrame,
)
from messages import key, say

from ..bench import SLOW, Bench
from ..errors import StepFailedError

READ_COUNT: Final = 25
FRAME_COUNT: Final = 8
# Share of the time-out that the cell grants a device; a larger latency leaves too little for a bad
# moment.
LATENCY_SHARE: Final = 0.5
PERIOD_SHARE: Final = 0.02  # largest difference of a camera's clock rate from the cell's
TRY_COUNTS: Final = 8.0  # tolerance of a motor trial: dead band, gear play and reading
# Share of a joint's range: the smallest motion that shows sign and scale, and the tolerance of
# arrival.
NUDGE_SHARE: Final = 0.01
ARRIVED_SHARE: Final = 0.0025
JAWS_MM: Final = 10.0
SUPPLY_POLL_S: Final = 0.02  # period at which the arm is asked for its motor supply
# Longest delay through the block's clock, its relay, a contactor and one reading; a longer one is
# another setting [s].
SUPPLY_SLACK_S: Final = 0.2
BINS_MS: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500)


IS_NOT_OK: Final = key("{signal} is not ok: {remedy}")
IS_UNKNOWN: Final = key("{signal} is unknown: {remedy}")


class DevicesStep:
    """Identity, latency, frames, clocks, and one small motion of everything that moves."""

    name = "devices"
    title = "identity and reply time of each device; then the smallest safe motion of each verb"
    needs: tuple[str, ...] = ()
    uses: tuple[CalibrationName, ...] = ()
    makes: tuple[CalibrationName, ...] = ()
    valid_days: int | None = 90

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Read everything, then move everything a little; return no calibration.

        Raises
        ------
        StepFailedError : a safety copy is not healthy, or something does not move as ordered
        DeclinedError : a person ended it
        DeviceError : a device does not answer or does not get there
        """
        await _identify(bench)
        await _time_readings(bench)
        for name in ("overhead", "inspection"):
            await _watch_frames(bench, name)
        await _try_motors(bench)
        await _prove_watchdog(bench)
        await _home(bench)
        await _nudge_joints(bench)
        await _move_grippers(bench)
        return {}


async def _identify(bench: Bench) -> None:
    devices = bench.devices
    for name, device in (
        ("arm", devices.arm),
        ("gripper", devices.gripper),
        ("lights", devices.lights),
        ("io", devices.io),
        ("overhead", devices.overhead),
        ("inspection", devices.inspection),
    ):
        kind = key("emulated") if name in bench.emulated else key("real")
        bench.evidence.find(f"{name}: {device.model} ({kind})")
    for signal, remedy in REQUIRED_SIGNALS.items():
        found = await settled_signal(devices.io, signal, bench.clock)
        if found is not Signal.OK:
            raise StepFailedError(
                say(
                    IS_NOT_OK if found is Signal.NOT_OK else IS_UNKNOWN,
                    signal=signal,
                    remedy=remedy,
                )
            )
        bench.evidence.find(f"{signal}: {found.value}")


# ---- only read -------------------------------------------------------------------------------
async def _time_readings(bench: Bench) -> None:
    cell, devices = bench.cell, bench.devices
    # where time runs faster, this computer's own share of a reading counts that much more
    faster = max(1.0, bench.clock.speed)
    arm_ms = faster * 1000 * LATENCY_SHARE * cell.detection.arm_silent_s
    modbus_ms = faster * 1000 * LATENCY_SHARE * cell.timing.modbus_reply_s
    readings: tuple[tuple[str, Callable[[], Awaitable[object]], float], ...] = (
        ("arm", devices.arm.read_jaws, arm_ms),
        (key("fixed gripper"), devices.gripper.status, modbus_ms),
        ("lights", devices.lights.connect, 4 * modbus_ms),  # four requests
    )
    for name, read, limit_ms in readings:
        took_ms = []
        for _ in range(READ_COUNT):
            begun_s = bench.clock.now_s()
            await read()
            took_ms.append(1000 * (bench.clock.now_s() - begun_s))
        bench.evidence.measure(
            f"{name}: 95 of 100 readings within",
            float(np.percentile(took_ms, 95)),
            "ms",
            high=limit_ms,
        )
        bench.evidence.find(f"{name}: {histogram(took_ms)}")


def histogram(took_ms: list[float]) -> str:
    """Return in words the distribution of reading times [ms]."""
    edges = (0.0, *BINS_MS, np.inf)
    counts, _ = np.histogram(took_ms, edges)
    rows = [
        f"{count} {'over' if np.isinf(high) else 'under'} {low if np.isinf(high) else high:g} ms"
        for count, low, high in zip(counts, edges, edges[1:], strict=False)
        if count
    ]
    return "of the readings " + ", ".join(rows)


async def _watch_frames(bench: Bench, name: CameraName) -> None:
    """Take frames in a row: none lost, at the rate set, by a clock that agrees with the cell's."""
    camera: Camera = getattr(bench.devices, name)
    panel = TABLE_PANEL if name == "overhead" else STATION_PANEL
    picture = await bench.imaging.shoot(name, {panel: 1.0})
    await bench.evidence.keep(f"{name}_first", picture, f"{name} camera, {panel} alone")
    await camera.resume()
    try:
        frames = await _frames_in_a_row(bench, camera)
    finally:
        await camera.pause()
        await bench.imaging.all_dark()
    tallies = getattr(camera, "stats", None)
    if tallies is not None:
        for what in ("lost", "error", "short", "broken"):
            count = getattr(tallies, f"{what}_count", 0)
            bench.evidence.measure(f"{name}: frames {what}", count, high=0)
    stamps = [frame.timestamp_s for frame in frames if isinstance(frame, TimedFrame)]
    if len(stamps) < FRAME_COUNT:
        bench.evidence.find(f"{name}: the frames of this camera have no time stamps")
        return
    steps = np.diff(stamps)
    fps = getattr(bench.cell.cameras, name).fps
    # a frame may be passed over while its predecessor is read: whole periods count as one
    periods = steps / np.maximum(1, np.rint(steps * fps))
    share = float(np.mean(periods)) * fps - 1
    bench.evidence.measure(
        f"{name}: its frame period against the cell's clock",
        100 * share,
        "%",
        low=-100 * PERIOD_SHARE,
        high=100 * PERIOD_SHARE,
    )


async def _frames_in_a_row(bench: Bench, camera: Camera) -> list[Frame]:
    frames: list[Frame] = []
    after_s = bench.clock.now_s()
    for _ in range(FRAME_COUNT):
        frame = await camera.frame_after(after_s)
        if isinstance(frame, TimedFrame):
            late_s = frame.timestamp_s - bench.clock.now_s()
            if late_s > 0:
                raise StepFailedError(
                    say(
                        "a frame is dated {late_s:.3f} s ahead of the cell's clock: its "
                        "stamps are invalid; check the camera's time stamps (margin_s in "
                        "the cell file)",
                        late_s=late_s,
                    )
                )
            after_s = frame.timestamp_s
        frames.append(frame)
    return frames


# ---- one motor, then axis by axis ------------------------------------------------------------
async def _try_motors(bench: Bench) -> None:
    # the driver itself: a proxy that counts verbs has their names, but is no such arm
    arm = bench.devices.arm
    if not isinstance(arm, FirstContact):
        await bench.permit_motion("The arm will home, which is its smallest motion.")
        return
    registers = await arm.read_registers()
    for motor, values in registers.items():
        shown = ", ".join(f"{name} {value}" for name, value in values.items())
        bench.evidence.find(f"{motor}: {shown}")
    await bench.permit_motion(
        "Motors are tried one by one, 50 counts each way with little force. With its power off, "
        "set all joints by hand to the middle of their ranges, zed low."
    )
    for motor in arm.motors:
        await bench.person.confirm("try_motor", f"The motor {motor} moves next, a little. Ready?")
        async with bench.moving(f"the motor {motor} moves by 50 counts", is_arm=True):
            await bench.arm.enable_power()
            tried = await arm.try_motor(motor)
        if abs(tried.went_counts) < TRY_COUNTS:
            # the wrist's joints share their motors, and both may lean on a stop
            bench.evidence.find(
                f"{motor}: a stop blocks it on both sides; homing has to show that it moves"
            )
            continue
        for name, value, wanted in (
            ("went", tried.went_counts, tried.ordered_counts),
            ("came back to", tried.back_counts, 0),
        ):
            bench.evidence.measure(
                f"{motor}: {name}",
                value,
                "counts",
                low=wanted - TRY_COUNTS,
                high=wanted + TRY_COUNTS,
            )


async def _prove_watchdog(bench: Bench) -> None:
    """Cut the communication with the I/O block, and check that the motors lose their supply."""
    io, arm = bench.devices.io, bench.devices.arm
    if not isinstance(io, MotorWatchdog) or io.watchdog_s is None:
        bench.evidence.find(
            "no watchdog is in the motors' supply: if the computer freezes, the arm is not "
            "stopped (`motor_relay` of the I/O block's settings)"
        )
        return
    await bench.person.confirm(
        "watchdog",
        "The motors lose their supply next: the I/O block receives nothing until its "
        "watchdog opens the relay in the supply. Ready?",
    )
    silence = asyncio.create_task(io.fall_silent())
    try:
        went_s = await _supply_went_s(bench, silence)
        if not await silence:
            raise StepFailedError(key("the I/O block's watchdog did not trip; see its web console"))
    finally:
        silence.cancel()
        await asyncio.gather(silence, return_exceptions=True)
    if went_s is not None:
        bench.evidence.measure(
            "motors without supply after the I/O block's last request",
            went_s,
            "s",
            high=io.watchdog_s + SUPPLY_SLACK_S,
        )
    bench.evidence.find(f"without supply: {await _try_in_vain(bench)}")
    await io.restore_motor_supply()
    if isinstance(arm, SupplySense):
        until_s = bench.clock.now_s() + SUPPLY_SLACK_S
        while not await arm.read_motor_supply():
            if bench.clock.now_s() > until_s:
                raise StepFailedError(
                    key(
                        "the I/O block's relay is closed, and the motors have no supply: check "
                        "fuse and wires of the relay's contact"
                    )
                )
            await bench.clock.sleep(SUPPLY_POLL_S)
    bench.evidence.find("the watchdog cut the motors' supply; its relay restored it")


async def _supply_went_s(bench: Bench, silence: asyncio.Task[bool]) -> float | None:
    """Return the time from the start of a silence to the motors' loss of supply; None if not known.

    Raises
    ------
    StepFailedError : they had none before, or have it at the end
    """
    arm = bench.devices.arm
    if not isinstance(arm, SupplySense):
        return None
    if not await arm.read_motor_supply():
        raise StepFailedError(key("the motors have no supply before the watchdog test"))
    begun_s = bench.clock.now_s()
    while not silence.done():
        if not await arm.read_motor_supply():
            return bench.clock.now_s() - begun_s
        await bench.clock.sleep(SUPPLY_POLL_S)
    if not await silence:
        return None  # it has not tripped, which is said before anything else
    raise StepFailedError(
        key(
            "the I/O block's watchdog has tripped, and the motors still have their supply: "
            "wire the relay's contact into the supply, in series with the emergency stop's"
        )
    )


async def _try_in_vain(bench: Bench) -> str:
    """Order a small motion that must not happen; return in words that it did not.

    Raises
    ------
    DeclinedError : a person saw that the arm does not yield
    StepFailedError : a motor moved
    """
    arm = bench.devices.arm
    if not isinstance(arm, FirstContact):
        await bench.person.confirm(
            "arm_is_limp", "Push the arm by hand: does it yield, as it does without motor power?"
        )
        return "the arm yields to a push by hand"
    motor = arm.motors[0]
    async with bench.moving(f"the motor {motor} is ordered to move, in vain", is_arm=True):
        try:
            went_counts = (await arm.try_motor(motor)).went_counts
        except ArmStalledError as error:
            return str(error)
    if abs(went_counts) > TRY_COUNTS:
        raise StepFailedError(
            say(
                "{motor}: it moved by {went_counts} counts without motor supply",
                motor=motor,
                went_counts=went_counts,
            )
        )
    return f"{motor} was ordered to move and went {went_counts} counts"


async def _home(bench: Bench) -> None:
    await bench.home_in_turn()
    bench.evidence.find("the arm is homed")
    await bench.park()


async def _nudge_joints(bench: Bench) -> None:
    """Move each joint a little and back, as a run would, and read its position."""
    parked = np.asarray(bench.layout.park_q, dtype=float)
    range_q = _ranges(bench)
    for number in range(len(parked)):
        goal = parked.copy()
        goal[number] += NUDGE_SHARE * range_q[number]
        if not bench.layout.arm.within_limits(goal).all():
            goal[number] = parked[number] - NUDGE_SHARE * range_q[number]
        name = f"joint {number + 1}"
        await bench.go(goal, f"trying {name}", speed=SLOW)
        await _require_there(bench, goal, name)
        await bench.go(parked, f"bringing {name} back", speed=SLOW)
    await _require_there(bench, parked, "the park")
    await bench.arm.stop(Stop.DEAD)
    bench.evidence.find("each joint moved a little and back; the arm confirmed a stop")


def _ranges(bench: Bench) -> FloatArray:
    """Return the travel of each joint [rad, mm]."""
    ends = bench.layout.arm.spread(np.stack([np.zeros(6), np.ones(6)]))
    return np.abs(np.asarray(ends[1] - ends[0], dtype=np.float64))


async def _require_there(bench: Bench, goal: FloatArray, what: str) -> None:
    off = np.abs(await bench.arm.read_q() - goal) / (ARRIVED_SHARE * _ranges(bench))
    if off.max() > 1:
        raise StepFailedError(
            say(
                "{what}: joint {number} is {times:.1f} times the allowed distance "
                "from its target; check its motor's scale and sign",
                what=what,
                number=int(off.argmax()) + 1,
                times=off.max(),
            )
        )


async def _move_grippers(bench: Bench) -> None:
    gripper = bench.devices.gripper
    await bench.person.confirm(
        "move_grippers", "Both grippers will open and close by 10 mm, empty. Ready?"
    )
    await bench.move_jaws("the fixed gripper is activated and may move", gripper.activate)
    half_mm = gripper.max_opening_mm / 2
    for opening_mm in (half_mm, half_mm + JAWS_MM, gripper.max_opening_mm):

        async def open_to(opening_mm: float = opening_mm) -> object:
            return await gripper.open_to(opening_mm)

        await bench.move_jaws(
            say("the fixed gripper opens to {opening_mm:.0f} mm", opening_mm=opening_mm), open_to
        )
        reached_mm = (await gripper.status()).opening_mm
        bench.evidence.measure(
            f"fixed gripper, sent to {opening_mm:.1f} mm",
            reached_mm,
            "mm",
            low=opening_mm - 2,
            high=opening_mm + 2,
        )
    await gripper.stop()
    half_mm = bench.arm.max_opening_mm / 2
    for opening_mm in (half_mm - JAWS_MM, half_mm):

        async def move_to(opening_mm: float = opening_mm) -> object:
            return await bench.arm.move_gripper_mm(opening_mm)

        await bench.move_jaws(f"the arm gripper moves to {opening_mm:.0f} mm", move_to)
        bench.evidence.measure(
            f"arm gripper, sent to {opening_mm:.1f} mm",
            await bench.arm.read_opening_mm(),
            "mm",
            low=opening_mm - 2,
            high=opening_mm + 2,
        )
