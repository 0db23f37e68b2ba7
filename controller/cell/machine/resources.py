"""Resources of one action at a time, in the only order of taking them; plain data."""

from collections.abc import Mapping
from enum import Enum
from typing import Final

from messages import key

from .table import Effect


class Resource(Enum):
    """A device or a space. The order of the members is the order in which they are taken."""

    TABLE = "table"
    STATION = "station"
    HAND_OFF = key("hand-off volume")
    TRAYS = "trays"
    ARM = "arm"
    ARM_GRIPPER = key("arm gripper")
    FIXED_GRIPPER = key("fixed gripper")
    OVERHEAD = key("overhead camera")
    INSPECTION = key("inspection camera")
    LAMPS = "lamps"

    @property
    def place(self) -> int:
        """Its place in that order."""
        return PLACES[self]


PLACES: Final[Mapping[Resource, int]] = {one: number for number, one in enumerate(Resource)}

_R = Resource
_HAND: Final = (_R.ARM, _R.ARM_GRIPPER)
# Devices that each action uses. An action that stops must not wait for anything; one that holds or
# ends a pause works within what the paused action has.
NEEDS: Final[Mapping[Effect, tuple[Resource, ...]]] = {
    Effect.HOME: tuple(Resource),
    Effect.RECOVER: tuple(Resource),
    Effect.ACQUIRE: (_R.TABLE, _R.OVERHEAD, _R.LAMPS),
    Effect.RECOGNISE: (),
    # the pose in the gripper may be measured once more
    Effect.PLAN: (_R.STATION, *_HAND, _R.INSPECTION, _R.LAMPS),
    Effect.GRASP: (_R.TABLE, *_HAND),
    Effect.PRESENT: (_R.STATION, *_HAND, _R.INSPECTION, _R.LAMPS),
    # while the part is judged, the arm goes on to the tray that it is likely to need
    Effect.INSPECT: (_R.TRAYS, *_HAND),
    Effect.HAND_OFF: (_R.HAND_OFF, *_HAND, _R.FIXED_GRIPPER),
    Effect.SET_DOWN: (_R.TABLE, *_HAND),
    # from wherever the arm stands
    Effect.WITHDRAW: (_R.TABLE, _R.STATION, _R.HAND_OFF, _R.TRAYS, *_HAND, _R.FIXED_GRIPPER),
    Effect.PLACE: (_R.TRAYS, *_HAND),
    Effect.COMPLETE: (_R.LAMPS,),
    Effect.HOLD: (),
    Effect.CONSULT: (),
    Effect.SUSPEND: (),
    Effect.UNSUSPEND: (),
    Effect.STOP_MOTION: (),
    Effect.ABORT_MOTION: (),
    Effect.CLEAR_FAULT: (),
}
