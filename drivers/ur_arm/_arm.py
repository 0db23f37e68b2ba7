"""The UR arm as the cell uses it: connect, power, move, grasp, stop.

It does not know its load, plans no path and avoids no obstacle. Sections (§) are those of ur.md.
"""

import logging
import math
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.clock import REAL_TIME, CellClock
from drivers.errors import PositionLostError, StalledError
from drivers.kinds import JawReading, Stop
from drivers.supervisor import BlindStop
from messages import key, say

from ._config import ControllerAddress, UrSettings
from ._errors import OutOfRangeError
from ._motion import check_target, move
from ._session import ArmIdentity, UrSession, require_no_alarm
from .jaws import Jaws, JawState, ZeroedJaws
from .model import UrShape, describe
from .ports import UrState
from .protocol import RobotMode, stopj

__all__ = ["UrArm"]

log = logging.getLogger(__name__)

BLIND_STOP_COUNT: Final = 2  # nobody sees whether it was taken; a second one does no harm
BLIND_SPACING_S: Final = 0.05
# somebody moved the arm if it stands farther than this from where it was last sent
KEPT_RAD: Final = math.radians(0.3)
JAWS_MM: Final = 1.5  # jaws that stand wider than this beyond what they pressed on were moved
ARRIVED_MM: Final = 1.0  # jaws this far from where they were sent have met something


class UrArm:
    """One arm. All verbs are coroutines of one event loop.

    A moving verb that is cancelled or fails stops the arm before it ends.

    Parameters
    ----------
    address : the controller
    shape : its model and lengths, from the cell file
    settings : its load, its gripper and its ports
    jaws : the gripper on it
    clock : the cell's clock
    silence_s : a line on which nothing has come for so long is silent [cell s]
    """

    def __init__(
        self,
        address: ControllerAddress,
        shape: UrShape,
        settings: UrSettings,
        jaws: Jaws,
        clock: CellClock = REAL_TIME,
        silence_s: float = 0.5,
    ) -> None:
        self._address, self._settings = address, settings
        self._model = describe(shape).model
        self._jaws: Jaws = ZeroedJaws(jaws, settings.jaw_zero_mm)
        self._session = UrSession(address, settings, shape, self._jaws, clock, silence_s)

    # ---- connection and power ------------------------------------------------------------------
    async def connect(self) -> ArmIdentity:
        """Open all ports and return the controller's identity; nothing moves, nothing is set.

        Raises
        ------
        LinkError : a port does not answer
        WrongDeviceError : another arm than the cell file's, or no arm
        """
        return await self._session.connect()

    async def aclose(self) -> None:
        """Stop, and release all ports; opens no jaw."""
        await self._session.aclose()

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    async def enable_power(self) -> None:
        """Switch on, release the brakes, set and prove payload and TCP.

        Only once people agree to motion.

        Raises
        ------
        SafetyStopError : its safety system holds it; the message has the way out
        LocalControlError : the pendant has it
        PowerOffError : it does not come up
        RefusedError : the controller refuses
        """
        await self._session.enable_power()

    async def stop(self, kind: Stop = Stop.DEAD) -> None:
        """Stop joints and jaws, ahead of all else; return once the joints are proven to be at rest.

        After `Stop.FREE` it can be led by hand, and is enabled anew before it moves.

        Raises
        ------
        StalledError : it moves on
        RefusedError : the controller does not let it be led by hand
        LinkError : the controller does not answer
        """
        await self._session.stop(kind)

    def blind_stop(self) -> BlindStop | None:
        """Return the stop in bytes, for the supervisor to send if this process cannot."""
        host = self._settings.host or self._address.host
        place = f"{host}:{self._settings.script_port}"
        line = stopj(math.radians(self._settings.stop_deg_s2))
        return BlindStop("arm", place, (line,), BLIND_SPACING_S, BLIND_STOP_COUNT)

    async def clear_safety_stop(self) -> None:
        """Close the safety pop-up and unlock a protective stop: only on a person's word (§3.2)."""
        await self._session.clear_safety_stop()

    @property
    def identity(self) -> ArmIdentity | None:
        """The result of `connect`; None when not connected."""
        return self._session.identity

    @property
    def model(self) -> str:
        """The arm's name in messages and the journal."""
        identity = self.identity
        name = say("Universal Robots {name}", name=self._model.name.upper().replace("E", "e"))
        return (
            name if identity is None else say("{name}, {model}", name=name, model=self._jaws.model)
        )

    @property
    def firmware(self) -> str:
        """The controller's software, once connected."""
        return (
            ""
            if self.identity is None
            else say("PolyScope {polyscope}", polyscope=self.identity.polyscope)
        )

    @property
    def max_opening_mm(self) -> float:
        """The largest opening of the jaws [mm]."""
        return self._jaws.max_opening_mm

    @property
    def is_powered(self) -> bool:
        """Whether power has been enabled here and nothing is known to have taken it away."""
        return self._session.is_powered

    @property
    def is_homed(self) -> bool:
        """Whether joints and jaws have positions: encoders are absolute, so once it is switched on.

        The jaws have theirs once they were activated.
        """
        return self.identity is not None and self._session.is_active

    # ---- positions -----------------------------------------------------------------------------
    async def home(self) -> None:
        """Activate the jaws if they are not, which opens and closes them; no joint moves.

        Raises
        ------
        PowerOffError : not enabled
        StalledError : the jaws do not become ready
        """
        async with self._session.motion(needs_home=False):
            if not (await self._session.read_jaws()).is_activated:
                await self._jaws.activate()
                await self._session.read_jaws()

    async def take_over_positions(self, between: ArrayLike) -> None:
        """Prove by the encoders that the arm stands where it was last sent; nothing moves.

        Parameters
        ----------
        between : (m, 6) joints between which the arm was last sent [rad]

        Raises
        ------
        PositionLostError : somebody moved it, it is switched off, or its jaws are not active
        """
        q = (await self._known()).q
        rows = np.atleast_2d(np.asarray(between, np.float64))
        off = np.maximum(rows.min(axis=0) - q, q - rows.max(axis=0))
        if off.max() > KEPT_RAD:
            joint = self._model.joint_names[int(np.argmax(off))].removesuffix("_rad")
            raise PositionLostError(
                say(
                    "arm: {joint} stands {degrees:.1f} deg beside where it was last "
                    "sent: somebody moved it",
                    joint=joint,
                    degrees=np.degrees(off.max()),
                )
            )
        if not (await self._session.read_jaws()).is_activated:
            raise PositionLostError(key("arm: its gripper has been without power"))

    async def read_kept_q(self, between: ArrayLike) -> NDArray[np.float64]:
        """Return the joints (6,): their encoders are absolute.

        Parameters
        ----------
        between : not needed

        Raises
        ------
        PositionLostError : it is switched off
        """
        return (await self._known()).q

    async def home_keeping_jaws(self, q_estimate: ArrayLike, opening_mm: float | None) -> float:
        """Press the jaws; no joint moves, and no jaw opens.

        Parameters
        ----------
        q_estimate : not needed: the encoders are absolute
        opening_mm : opening at which the jaws pressed on what they hold, None for empty jaws

        Returns
        -------
        the opening at which they press now [mm]

        Raises
        ------
        PositionLostError : the jaws were moved meanwhile, or are not active: activation opens them
        """
        async with self._session.motion(needs_home=False):
            jaws = await self._session.read_jaws()
            if not jaws.is_activated:
                raise PositionLostError(
                    key(
                        "arm: its gripper has been without power, and activation would open "
                        "it: take the part out with `cellctl recover --open arm`, or by hand"
                    )
                )
            if opening_mm is not None and jaws.opening_mm > opening_mm + JAWS_MM:
                raise PositionLostError(
                    say(
                        "arm: its jaws stand at {opening_mm:.1f} mm, {pressed_mm:.1f} mm "
                        "when they pressed: somebody moved them",
                        opening_mm=jaws.opening_mm,
                        pressed_mm=opening_mm,
                    )
                )
            return (await self._jaws.close(self._jaws.force_range_n[0], 1.0)).opening_mm

    async def _known(self) -> UrState:
        state = await self._session.state()
        if state.robot_mode < RobotMode.IDLE:
            raise PositionLostError(key("arm: switched off, so that its encoders are not read"))
        return state

    async def read_q(self) -> NDArray[np.float64]:
        """Return the arm's joints (6,) [rad].

        Raises
        ------
        PositionLostError : switched off, or not homed
        """
        if not self.is_homed:
            raise PositionLostError(key("arm: not homed: its gripper is not active"))
        return (await self._known()).q

    async def move_joints(self, q: ArrayLike, *, speed_share: float = 1.0) -> None:
        """Move to joints (6,) [rad], all arriving together; return when they are there, at rest.

        Parameters
        ----------
        q : (6,) target
        speed_share : share of the usual speed, above 0 to 1

        Raises
        ------
        ValueError : a share outside 0 to 1
        OutOfRangeError : beyond a joint's range
        PowerOffError, SafetyStopError : it is not ready
        RefusedError : the controller did not begin; the message has what it says
        ArmStalledError : it ended short of the target
        MotionStoppedError : `stop` was called
        """
        if not 0.0 < speed_share <= 1.0:
            raise ValueError(f"a share of the speed is above 0 to 1, not {speed_share}")
        target = np.asarray(q, np.float64)
        check_target(self._model, target)
        async with self._session.motion() as guard:
            await move(self._session, self._model, target, speed_share, guard)

    # ---- gripper -------------------------------------------------------------------------------
    async def grasp(self, force: int, *, speed_share: float = 1.0) -> float:
        """Close the jaws until they rest, on something or on each other; return the opening [mm].

        Parameters
        ----------
        force : newtons; the gripper's least and largest force bound it
        speed_share : share of the usual speed, above 0 to 1

        Raises
        ------
        ValueError : a force above the gripper's, or not above 0; a share outside 0 to 1
        StalledError : the jaws do not come to rest
        """
        min_force_n, max_force_n = self._jaws.force_range_n
        if not 0 < force <= max_force_n:
            raise ValueError(
                f"the gripper presses with above 0 to {max_force_n:g} N, not {force:g} N"
            )
        if not 0.0 < speed_share <= 1.0:
            raise ValueError(f"a share of the speed is above 0 to 1, not {speed_share:g}")
        async with self._session.motion():
            jaws = await self._jaws.close(max(float(force), min_force_n), speed_share)
            return jaws.opening_mm

    async def move_gripper_mm(self, opening_mm: float) -> float:
        """Move the jaws to an opening [mm] in empty air; return the one reached.

        Raises
        ------
        OutOfRangeError : the jaws do not open so far
        StalledError : something is in the way
        """
        if not 0.0 <= opening_mm <= self.max_opening_mm:
            raise OutOfRangeError(
                say(
                    "arm gripper: 0 to {max_opening_mm:.1f} mm, not {opening_mm:.1f} mm",
                    max_opening_mm=self.max_opening_mm,
                    opening_mm=opening_mm,
                )
            )
        async with self._session.motion():
            reached_mm = (await self._jaws.move_to(opening_mm)).opening_mm
            if abs(reached_mm - opening_mm) > ARRIVED_MM:
                raise StalledError(
                    say(
                        "arm gripper: the jaws met an obstacle at {reached_mm:.1f} mm "
                        "while moving to {opening_mm:.1f} mm; see what is between or "
                        "beside them",
                        reached_mm=reached_mm,
                        opening_mm=opening_mm,
                    )
                )
            return reached_mm

    async def read_opening_mm(self) -> float:
        """Return the present opening of the jaws [mm].

        The cell's heartbeat: proves that the controller sends states, and that no stop of its
        safety system waits for a person.

        Raises
        ------
        SafetyStopError : one does
        PositionLostError : the jaws have been without power
        """
        require_no_alarm(await self._session.state())
        jaws = await self._session.read_jaws()
        if not jaws.is_activated:
            raise PositionLostError(key("arm: its gripper has been without power; home it"))
        return jaws.opening_mm

    async def read_jaws(self) -> JawReading:
        """Return the state of the jaws, homed or not; nothing moves."""
        await self._session.state()
        jaws = await self._session.read_jaws()
        return JawReading(jaws.is_pressing, jaws.opening_mm)

    async def drive_jaws(self, by_mm: float) -> float:
        """Open (below 0: close) the jaws by a travel [mm]; return the travel they made.

        Raises
        ------
        PositionLostError : they are not active: activation would open and close them
        """
        async with self._session.motion(needs_home=False):
            before = await self._session.read_jaws()
            self._require_active(before)
            target_mm = min(max(before.opening_mm + by_mm, 0.0), self.max_opening_mm)
            after = await self._jaws.move_to(target_mm)
            return abs(after.opening_mm - before.opening_mm)

    @staticmethod
    def _require_active(jaws: JawState) -> None:
        if not jaws.is_activated:
            raise PositionLostError(
                key(
                    "arm: its gripper has been without power, and activation would open and "
                    "close it: take out by hand what it holds, then home the arm"
                )
            )
