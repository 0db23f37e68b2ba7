"""One joint move, watched to its end: begun, paused, arrived, or neither.

Sections (§) are those of ur.md.
"""

import logging
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ArmStalledError, RefusedError
from messages import key, say

from ._errors import OutOfRangeError
from ._session import STILL_RAD_S, Guard, UrSession, is_playing, require_safe
from .model import UrModel
from .ports import UrState
from .protocol import PAUSED, PAUSES, movej

__all__ = ["ARRIVED_RAD", "check_target", "move"]

log = logging.getLogger(__name__)

ARRIVED_RAD: Final = 1e-3  # of each joint: 0.9 mm at the TCP of the stretched UR5e
MOVED_RAD: Final = 2e-3  # a joint this far from its start has begun to move
BEGIN_S: Final = 1.0  # from the line sent to the program that runs it [cell s]
PATIENCE: Final = 2.0  # times the forecast, plus the same in seconds, at full speed scaling
PAUSE_S: Final = 1.0  # a pause that is longer is reported: a door, a paused program [cell s]
SLOW_SHARE: Final = 0.01  # a slider below this is noted once: the move waits
ENDED_COUNT: Final = 5  # states without a program and at rest, before a move has ended short


def check_target(model: UrModel, q: NDArray[np.float64]) -> None:
    """Check joints before any byte goes out.

    Raises
    ------
    OutOfRangeError : not six finite numbers, or beyond a joint's range
    """
    if q.shape != (6,) or not np.isfinite(q).all():
        raise OutOfRangeError(say("arm: joints are six finite numbers, not {q}", q=q))
    if not model.within_limits(q):
        raise OutOfRangeError(say("arm: {limit_report}", limit_report=model.limit_report(q)))


async def move(
    session: UrSession, model: UrModel, q: NDArray[np.float64], share: float, guard: Guard
) -> None:
    """Move to joints, all arriving together; return when they are there and at rest.

    Parameters
    ----------
    session : of the arm, held for this motion
    model : with the timing
    q : (6,) target, checked
    share : share of the usual speed
    guard : raises once a stop was called

    Raises
    ------
    RefusedError : nothing began; the message has what the controller says
    LocalControlError : nothing began: the pendant has the arm
    ArmStalledError : it ended short of the target, or took too long
    SafetyStopError : its safety system stopped it
    """
    begin = await session.state()
    guard()
    step = q - begin.q
    if np.abs(step).max() <= ARRIVED_RAD and np.abs(begin.qd).max() <= STILL_RAD_S:
        return
    timing = model.timing
    session.forget_told()
    await session.send(
        movej(q.tolist(), timing.acceleration_rad_s2, timing.leading_speed(step, share))
    )
    limit_s = PATIENCE * float(timing.move_seconds(begin.q, q, share)) + PATIENCE
    watch = _Watch(session, q, begin, limit_s)
    try:
        while not watch.takes(await session.next_state(), guard):
            pass
    except RefusedError:
        await session.require_remote()
        raise


class _Watch:
    """The course of one move, state by state.

    Time runs by the share of the speed at which the controller executes programs: a slow slider
    takes longer and is no error.
    """

    def __init__(
        self, session: UrSession, q: NDArray[np.float64], begin: UrState, limit_s: float
    ) -> None:
        self._session, self._q, self._begin, self._limit_s = session, q, begin, limit_s
        self._then_s = session.clock.attended_s()
        self._sent_s = self._then_s
        self._progress_s = self._paused_s = 0.0
        self._has_begun = self._is_noted = False
        self._idle_count = 0

    def takes(self, state: UrState, guard: Guard) -> bool:
        """Take the next state in; return whether the arm has arrived."""
        guard()
        now_s = self._session.clock.attended_s()
        passed_s, self._then_s = now_s - self._then_s, now_s
        is_held = state.safety_mode in PAUSES or state.runtime_state in PAUSED
        self._paused_s = self._paused_s + passed_s if is_held else 0.0
        if is_held and self._paused_s <= PAUSE_S:
            return False
        require_safe(state)
        if is_held:
            raise ArmStalledError(
                key(
                    "arm: its program is paused and does not go on, as after a safeguard stop; "
                    "stopped"
                )
            )
        self._progress_s += passed_s * state.speed_share
        self._note_slow(state)
        is_still = bool(np.abs(state.qd).max() <= STILL_RAD_S)
        off = np.abs(state.q - self._q)
        if bool(off.max() <= ARRIVED_RAD) and is_still:
            return True
        has_moved = bool(np.abs(state.q - self._begin.q).max() > MOVED_RAD)
        self._has_begun |= is_playing(state) or has_moved or not is_still
        if not self._has_begun:
            if now_s - self._sent_s > BEGIN_S:
                raise RefusedError(
                    say("arm: the move was not begun{told}", told=self._session.told()), 0
                )
            return False
        self._idle_count = self._idle_count + 1 if is_still and not is_playing(state) else 0
        worst_deg = float(np.degrees(off.max()))
        if self._idle_count >= ENDED_COUNT:
            raise ArmStalledError(
                say(
                    "arm: ended {worst_deg:.2f} deg short of its target{told}",
                    worst_deg=worst_deg,
                    told=self._session.told(),
                )
            )
        if self._progress_s > self._limit_s:
            raise ArmStalledError(
                say(
                    "arm: not there after {progress_s:.1f} s at full speed, "
                    "{worst_deg:.2f} deg short of its target; stopped",
                    progress_s=self._progress_s,
                    worst_deg=worst_deg,
                )
            )
        return False

    def _note_slow(self, state: UrState) -> None:
        if state.speed_share < SLOW_SHARE and not self._is_noted:
            self._is_noted = True
            log.warning("arm: the speed slider is at %.0f %%: waiting", 100 * state.speed_share)
