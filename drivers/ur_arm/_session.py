"""One arm's connections, its power, and the queue of its motions.

Sections (§) are those of ur.md.
"""

import asyncio
import logging
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from drivers.clock import CellClock
from drivers.errors import (
    DeviceError,
    LinkError,
    MotionStoppedError,
    RefusedError,
    StalledError,
    UnpluggedError,
    WrongDeviceError,
)
from drivers.kinds import Stop
from drivers.tasks import run_to_end
from messages import key, say

from ._config import ControllerAddress, UrSettings
from ._errors import LocalControlError, OutOfRangeError, PowerOffError, SafetyStopError
from .jaws import Jaws, JawState
from .model import UrShape
from .ports import Dashboard, RtdePort, ScriptPort, UrState
from .protocol import (
    AT_ONCE,
    OPERATES,
    PLAYING,
    RobotMode,
    advice,
    freedrive,
    mode_words,
    safety_words,
    set_payload,
    set_tcp,
    stopj,
)

__all__ = ["STILL_RAD_S", "ArmIdentity", "Guard", "UrSession"]

log = logging.getLogger(__name__)

Guard = Callable[[], None]

STILL_RAD_S: Final = 1e-2  # actual_qd of a joint at rest: its encoder's noise is a few mrad/s
STILL_COUNT: Final = 2  # states at rest, one after the other
STOP_S: Final = 0.3  # from the line sent to a standstill, besides the deceleration itself [cell s]
POWER_S: Final = 60.0  # joints boot, brakes click [cell s]
LED_S: Final = 600.0  # led by hand for so long at the most; then its motors hold again [cell s]
SETTING_S: Final = 2.0  # a setting is back in the states [cell s]
PAYLOAD_KG: Final = 1e-3
SETTING_MM: Final = 0.1
E_SERIES: Final = 5  # major version of its software


@dataclass(frozen=True, slots=True)
class ArmIdentity:
    """The controller that answered, and whether homing is needed.

    Attributes
    ----------
    model : as it names the arm, empty where it does not
    polyscope : its software's version
    was_restarted : its gripper has been without power, so that its opening means nothing; joints
        have absolute encoders
    """

    model: str
    polyscope: str
    was_restarted: bool


class UrSession:
    """One arm's connections.

    Parameters
    ----------
    address : the controller
    settings, shape : of the arm, from the cell file
    jaws : the gripper on it
    clock : the cell's clock
    silence_s : a line on which nothing has come for so long is silent [cell s]
    """

    def __init__(
        self,
        address: ControllerAddress,
        settings: UrSettings,
        shape: UrShape,
        jaws: Jaws,
        clock: CellClock,
        silence_s: float,
    ) -> None:
        self._address, self._settings, self._shape = address, settings, shape
        self.jaws, self.clock, self._silence_s = jaws, clock, silence_s
        self._host = settings.host or address.host
        self._dashboard = Dashboard(self._host, settings.dashboard_port, clock)
        self._rtde: RtdePort | None = None
        self._script: ScriptPort | None = None
        self.identity: ArmIdentity | None = None
        self.is_powered = False
        self.is_active = False
        self._was_local = False
        self._is_led = False
        self._stop_count = 0
        self._one_motion = asyncio.Lock()

    # ---- connection ----------------------------------------------------------------------------
    async def connect(self) -> ArmIdentity:
        """Open all ports and return who answered; nothing moves and nothing is set.

        Raises
        ------
        LinkError : a port does not answer
        WrongDeviceError : another arm, or no arm
        """
        await self._close()
        address, settings = self._address, self._settings
        try:
            self._rtde = await RtdePort.open(
                address.host, address.rtde_port, self.clock, self._silence_s, settings.rtde_hz
            )
            await self._dashboard.open()
            model = await self._model()
            self._was_local = not await self._is_remote()
            self._script = await ScriptPort.open(self._host, settings.script_port, self.clock)
            jaws = await self.jaws.connect()
        except BaseException:
            await self._close()
            raise
        self.is_active = jaws.is_activated
        version = ".".join(map(str, self._rtde.version[:3]))
        self.identity = ArmIdentity(model, version, not jaws.is_activated)
        log.info("arm connected: %s, PolyScope %s", model or "model not told", version)
        return self.identity

    async def _model(self) -> str:
        """Return the model as the controller names it.

        Raises
        ------
        WrongDeviceError : it is not the cell file's
        """
        answer = await self._dashboard.ask("get robot model")
        told = re.search(r"UR\d+", answer, re.IGNORECASE)
        wanted = re.match(r"ur\d+", self._shape.model)
        assert wanted is not None, "all models have a number"
        if told is None:
            return ""
        series = "e" if self._rtde is not None and self._rtde.version[0] >= E_SERIES else ""
        if told[0].lower() != wanted[0] or self._shape.model.endswith("e") != bool(series):
            raise WrongDeviceError(
                say(
                    "arm: the controller has a {told}{series}, the cell file says "
                    "`model: {model}`; set `arm.shape.model` to the arm that is there",
                    told=told[0].upper(),
                    series=series,
                    model=self._shape.model,
                )
            )
        return f"{told[0].upper()}{series}"

    async def aclose(self) -> None:
        """Stop, and release all ports; opens no jaw."""
        if self._script is not None and self._rtde is not None:
            self._stop_count += 1
            await run_to_end(self.halt_quietly())
        await self._close()

    async def _close(self) -> None:
        self.is_powered = False
        self.identity = None
        rtde, self._rtde = self._rtde, None
        script, self._script = self._script, None
        for one in (rtde, script, self._dashboard, self.jaws):
            if one is not None:
                with suppress(DeviceError, OSError):
                    await one.aclose()

    @property
    def rtde(self) -> RtdePort:
        """The arm's states.

        Raises
        ------
        LinkError : not connected
        """
        if self._rtde is None:
            raise LinkError(key("arm: not connected"))
        return self._rtde

    @property
    def script(self) -> ScriptPort:
        """The script port.

        Raises
        ------
        LinkError : not connected
        """
        if self._script is None:
            raise LinkError(key("arm: not connected"))
        return self._script

    async def state(self) -> UrState:
        """Return a state younger than this call."""
        return await self.rtde.fresh()

    async def next_state(self) -> UrState:
        """Return the next state to be read, for who looks at one after the other."""
        return await self.rtde.next()

    async def read_jaws(self) -> JawState:
        """Return a fresh reading of the jaws, and note whether they are active."""
        jaws = await self.jaws.read()
        self.is_active = jaws.is_activated
        return jaws

    async def send(self, line: bytes) -> None:
        """Send a line to run.

        Raises
        ------
        LocalControlError : the pendant has the arm, and has ended the connection
        UnpluggedError : the connection is gone
        """
        try:
            self.script.send(line)
        except UnpluggedError:
            await self.require_remote()
            raise

    def told(self) -> str:
        """Return what the controller has said of refused lines, as the end of a sentence."""
        texts = [*self.script.texts, *self.rtde.texts]
        return (
            say("; it says: {fromkeys}", fromkeys=" / ".join(dict.fromkeys(texts))) if texts else ""
        )

    def forget_told(self) -> None:
        """Forget what the controller has said so far."""
        self.script.texts.clear()
        self.rtde.texts.clear()

    # ---- power ---------------------------------------------------------------------------------
    async def enable_power(self) -> None:
        """Switch the arm on, release its brakes, set and prove payload and TCP.

        Raises
        ------
        SafetyStopError : its safety system holds it
        LocalControlError : the pendant has it
        PowerOffError : it does not come up
        RefusedError : a setting was not taken
        """
        state = await self.state()
        require_safe(state)
        await self.require_remote()
        if self._is_led:
            await self._halt(Stop.DEAD)
        if self._was_local or not self.script.is_open:
            await self._open_anew()
        if state.robot_mode != RobotMode.RUNNING:
            if state.robot_mode < RobotMode.IDLE:
                await self._dashboard.order("power on", r"powering on")
                await self._until_mode(RobotMode.IDLE)
            await self._dashboard.order("brake release", r"brake releasing")
            state = await self._until_mode(RobotMode.RUNNING)
        await self._set_load(state)
        await self.read_jaws()
        self.is_powered = True

    async def require_remote(self) -> None:
        """Check that the arm takes orders from here.

        Raises
        ------
        LocalControlError : the pendant has it
        """
        if not await self._is_remote():
            self._was_local = True
            raise LocalControlError(
                key(
                    "arm: in local control: on the pendant, choose `Remote Control` at the top "
                    "right (enabled under Settings, System)"
                )
            )

    async def _open_anew(self) -> None:
        """Open the ports of orders anew: made in local control, they stay without (§4.5)."""
        old, self._script = self.script, None
        await old.aclose()
        await self._dashboard.open()
        self._script = await ScriptPort.open(self._host, self._settings.script_port, self.clock)
        self._was_local = False

    async def _is_remote(self) -> bool:
        # a CB3 knows no such mode and answers that it does not understand
        return (await self._dashboard.ask("is in remote control")).lower() != "false"

    async def _until_mode(self, mode: RobotMode) -> UrState:
        until_s = self.clock.attended_s() + POWER_S
        while True:
            state = await self.state()
            require_safe(state)
            if state.robot_mode >= mode:
                return state
            if self.clock.attended_s() > until_s:
                raise PowerOffError(
                    say(
                        "arm: after {power_s:g} s {mode_words}; read the log on the pendant",
                        power_s=POWER_S,
                        mode_words=mode_words(state.robot_mode),
                    )
                )

    async def _set_load(self, state: UrState) -> None:
        """Set payload and TCP where the states have others, and prove them by the states."""
        settings = self._settings
        centre = np.array(settings.centre_of_mass_mm)
        tcp = np.array([0.0, 0.0, self._shape.flange_to_tcp_mm])

        def is_loaded(now: UrState) -> bool:
            kg, at = now.payload_kg, now.centre_mm
            is_mass = kg is None or abs(kg - settings.payload_kg) <= PAYLOAD_KG
            return is_mass and (at is None or bool(np.abs(at - centre).max() <= SETTING_MM))

        def is_tool(now: UrState) -> bool:
            return now.tcp_mm is None or bool(np.abs(now.tcp_mm - tcp).max() <= SETTING_MM)

        for what, line, is_set, is_told in (
            (
                "payload",
                set_payload(settings.payload_kg, settings.centre_of_mass_mm),
                is_loaded,
                state.payload_kg is not None,
            ),
            ("TCP", set_tcp(self._shape.flange_to_tcp_mm), is_tool, state.tcp_mm is not None),
        ):
            if is_told and is_set(state):
                continue
            self.forget_told()
            await self.send(line)
            until_s = self.clock.attended_s() + SETTING_S
            while not is_set(state := await self.state()):
                if self.clock.attended_s() > until_s:
                    raise RefusedError(
                        say("arm: the {what} was not taken{told}", what=what, told=self.told()), 0
                    )

    async def _let_lead(self) -> None:
        """Let the arm be led by hand until it is enabled, stopped or moved again (§4.6).

        Raises
        ------
        RefusedError : the controller does not
        """
        self.forget_told()
        self._is_led, self.is_powered = True, False
        await self.send(freedrive(LED_S))
        until_s = self.clock.attended_s() + SETTING_S
        while not is_playing(await self.state()):
            if self.clock.attended_s() > until_s:
                raise RefusedError(say("arm: it cannot be led by hand{told}", told=self.told()), 0)

    async def clear_safety_stop(self) -> None:
        """Close the safety pop-up and unlock a protective stop: on a person's word only (§3.2).

        Raises
        ------
        RefusedError : too early, or another cause than a protective stop
        """
        await self._dashboard.ask("close safety popup")
        await self._dashboard.order("unlock protective stop", r"protective stop releasing")

    # ---- how a motion ends ---------------------------------------------------------------------
    async def stop(self, kind: Stop) -> None:
        """Stop all joints and the jaws; return once the joints are proven to be at rest.

        Raises
        ------
        StalledError : they move on
        LinkError : the controller does not answer
        """
        self._stop_count += 1
        await run_to_end(self._halt(kind))

    async def _halt(self, kind: Stop) -> None:
        settings = self._settings
        self._is_led = False
        deg_s2 = settings.ramp_deg_s2 if kind is Stop.RAMP else settings.stop_deg_s2
        accel = float(np.radians(deg_s2))
        try:
            self.script.send(stopj(accel))
        except LinkError as error:
            log.error("%s: stopping it by the dashboard", error)
            await self._dashboard.ask("stop")
        jaws = self.jaws.stop() if self.is_active else asyncio.sleep(0)
        joints, fingers = await asyncio.gather(
            self._until_still(accel), jaws, return_exceptions=True
        )
        for failure in (joints, fingers):
            if isinstance(failure, BaseException):
                raise failure
        if kind is Stop.FREE:
            await self._let_lead()

    async def _until_still(self, accel_rad_s2: float) -> None:
        """Wait until the states show all joints at rest after a stop."""
        still, until_s = 0, None
        state = await self.state()
        while True:
            speed = float(np.abs(state.qd).max())
            still = still + 1 if speed <= STILL_RAD_S else 0
            now_s = self.clock.attended_s()
            until_s = now_s + STOP_S + 2.0 * speed / accel_rad_s2 if until_s is None else until_s
            if now_s > until_s and still == 0:
                await self._dashboard.ask("stop")
                raise StalledError(
                    say(
                        "arm: still moves at {degrees:.0f} deg/s after a stop; press the "
                        "emergency stop",
                        degrees=np.degrees(speed),
                    )
                )
            if still >= STILL_COUNT:
                return
            state = await self.next_state()

    async def halt_quietly(self) -> None:
        """Dead-stop while an earlier error is being raised: log a failure only."""
        try:
            await self._halt(Stop.DEAD)
        except DeviceError as error:
            log.error("arm: the stop failed too: %s", error)

    @asynccontextmanager
    async def motion(self, *, needs_home: bool = True) -> AsyncIterator[Guard]:
        """Yield a guard and hold the arm for one motion; if that fails, it is stopped.

        Yields a guard that raises once `stop` has been called, which also ends those motions that
        were still waiting for the arm.

        Raises
        ------
        PowerOffError : not enabled
        SafetyStopError : its safety system holds it
        MotionStoppedError : `stop` was called while the motion waited for the arm
        """
        stop_count = self._stop_count

        def guard() -> None:
            if self._stop_count != stop_count:
                raise MotionStoppedError(key("arm: the motion was stopped on request"))

        async with self._one_motion:
            guard()
            state = await self.state()
            require_safe(state)
            if not self.is_powered or state.robot_mode != RobotMode.RUNNING:
                self.is_powered = False
                why = key("not enabled") if state.robot_mode == RobotMode.RUNNING else ""
                raise PowerOffError(
                    say(
                        "arm: {why}: enable its power first",
                        why=why or mode_words(state.robot_mode),
                    )
                )
            if needs_home and not self.is_active:
                raise PowerOffError(
                    key(
                        "arm: its gripper is not active, as after a loss of power: home the "
                        "arm, which moves the jaws"
                    )
                )
            try:
                yield guard
            except (OutOfRangeError, MotionStoppedError):
                raise  # nothing has been sent, or a stop has
            except BaseException:
                await run_to_end(self.halt_quietly())
                raise


def require_safe(state: UrState) -> None:
    """Check that the robot's safety system lets it move.

    Raises
    ------
    SafetyStopError : it does not; the message has the way out
    """
    if state.safety_mode not in OPERATES:
        raise SafetyStopError(
            say(
                "arm: {safety_words}: {advice}",
                safety_words=safety_words(state.safety_mode),
                advice=advice(state.safety_mode),
            ),
            state.safety_mode,
        )


def require_no_alarm(state: UrState) -> None:
    """Check that nothing of the robot's safety system needs a person at the robot.

    Raises
    ------
    SafetyStopError : it does
    """
    if state.safety_mode in AT_ONCE:
        require_safe(state)


def is_playing(state: UrState) -> bool:
    """Return whether a program runs."""
    return state.runtime_state == PLAYING
