"""Admits motions: the facts that interlock rules require must be known before anything moves."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from controller.cell.custody import Custody
from controller.cell.devices.interlocks import (
    BUILT_IN_RULES,
    CheckTime,
    Facts,
    Rule,
    Truth,
    Violation,
    first_violation,
)
from controller.cell.errors import InterlockError
from controller.config.interlock_rules import SIGNALS
from controller.planning import JointPath
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from drivers.kinds import FixedGripper, IoBlock
from messages import key

from .faults import Retries

# A TCP this near to the fixed gripper's may bring part, jaws or fingers between its jaws.
NEAR_MM: Final = 250.0
# Jaws this near to their widest opening rest against their own end.
END_MM: Final = 3.0

CUSTODY_FACTS: Final = {
    "custody_on_table": Custody.ON_TABLE,
    "custody_in_arm": Custody.IN_ARM,
    "custody_in_fixed": Custody.IN_FIXED,
    "custody_in_both": Custody.IN_BOTH,
    "custody_placed": Custody.PLACED,
    "custody_lost": Custody.LOST,
}


class Interlocks:
    """The interlock rules of the cell, and the known state of their facts.

    Parameters
    ----------
    io : I/O block with the signals
    fixed : fixed gripper, read before the arm comes near it
    layout : layout with the pose of the fixed gripper
    custody : function that returns the gripper, tray or table with the part
    retries : retries of a reading that does not come
    rules : rules of the cell
    """

    def __init__(
        self,
        io: IoBlock,
        fixed: FixedGripper,
        layout: CellLayout,
        custody: Callable[[], Custody],
        retries: Retries,
        rules: Sequence[Rule] = BUILT_IN_RULES,
    ) -> None:
        self._io = io
        self._fixed = fixed
        self._layout = layout
        self._custody = custody
        self._retries = retries
        self._rules = rules
        self._holding_rules = tuple(rule for rule in rules if rule.holds)
        self._moving: dict[str, Truth] = {}

    async def admit_path(self, path: JointPath) -> None:
        """Check that the arm may move along a joint path, each waypoint (6,).

        Raises
        ------
        InterlockError : a rule does not hold, or cannot be known to hold
        DeviceError : the fixed gripper does not answer
        """
        is_near = any(self._is_near(tcp_pose(self._layout, q)[:3, 3]) for q in path)
        self._moving = {"moves_arm": Truth.TRUE, "near_hand_off": Truth.of(is_near)}
        if is_near:
            status = await self._retries.run("gripper", key("fixed gripper"), self._fixed.status)
            is_wide = status.opening_mm > self._fixed.max_opening_mm - END_MM
            self._moving["fixed_gripper_free"] = Truth.of(
                None if status.is_moving else is_wide or not status.has_contact
            )
        self._require(CheckTime.ADMIT)

    def admit_jaws(self) -> None:
        """Check that jaws may move.

        Raises
        ------
        InterlockError : a rule does not hold, or cannot be known to hold
        """
        self._moving = {"moves_jaws": Truth.TRUE}
        self._require(CheckTime.ADMIT)

    def violation(self, changed: Facts) -> Violation | None:
        """Return the first rule that does not hold while something may move, None if all do.

        Rules that do not depend on the changed facts are left out.

        Parameters
        ----------
        changed : facts that are new, with their values
        """
        rules = [
            rule
            for rule in self._rules
            if (rule.when.names() | rule.require.names()) & changed.keys()
        ]
        return first_violation(rules, CheckTime.DURING, {**self._facts(), **changed})

    def holding(self) -> Violation | None:
        """Return the first rule that holds the run before its next motion; None if none does."""
        return first_violation(self._holding_rules, CheckTime.ADMIT, self._facts())

    def _require(self, check: CheckTime) -> None:
        violation = first_violation(self._rules, check, self._facts())
        if violation is not None:
            raise InterlockError(violation.message, violation.code, holds=violation.rule.holds)

    def _facts(self) -> dict[str, Truth]:
        custody = self._custody()
        is_known = custody is not Custody.UNKNOWN
        held = {
            name: Truth.of(custody is value if is_known else None)
            for name, value in CUSTODY_FACTS.items()
        }
        idle = dict.fromkeys(("moves_arm", "moves_jaws", "near_hand_off"), Truth.FALSE)
        signals = {name: Truth.of_signal(self._io.signal(name)) for name in SIGNALS}
        fixed = {"always": Truth.TRUE, "person_inside": Truth.FALSE}
        return {**signals, **held, **fixed, **idle, **self._moving}

    def _is_near(self, p_mm: np.ndarray) -> bool:
        return float(np.linalg.norm(p_mm - self._layout.T_world_fixed_tcp[:3, 3])) < NEAR_MM
