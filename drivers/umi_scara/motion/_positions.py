"""The known positions of the axes, and when they must be read again before use.

Sections (§) are those of umi_rtx.md.
"""

from collections.abc import Callable, Iterable, Mapping

from drivers.errors import PositionLostError
from messages import say

from ..line import Guard, LineUncertainError
from ..protocol.constants import Axis, Parameter, Simple
from ._axes import Axes
from ._counters import Known, judge_counters
from ._moves import on_ip


class Positions:
    """The positions of the axes, as far as they are known.

    Parameters
    ----------
    on_lost : called when counters turn out to mean nothing any more

    Attributes
    ----------
    is_homed : True if counts mean positions
    dead_bands : DEAD_BAND of each axis, read when it was homed [counts]
    grasps : True if the jaws press on something, so that their target is beyond their position
    """

    def __init__(self, on_lost: Callable[[], None]) -> None:
        self._on_lost = on_lost
        self.is_homed = False
        self.dead_bands: dict[Axis, int] = {}
        self.grasps = False
        self._at_rest: dict[Axis, int] = {}  # where axes were read to rest, at their targets
        self._known: Known = {}
        self._is_sure = False  # every target is where its axis stands, every parameter as written
        self._may_be_relabelled = False  # counters must be compared with `_known`
        self._may_be_zeroed = False  # counters may have been set to zero

    # ---- what happened -------------------------------------------------------------------------
    def forget(self) -> None:
        """Forget all: an IP has restarted, or the line was closed."""
        self.is_homed = False
        self._at_rest.clear()
        self._known.clear()
        self._is_sure = self._may_be_relabelled = self._may_be_zeroed = False

    def begin_homing(self) -> None:
        """Note that counts mean nothing until `note_homed`."""
        self.is_homed = False
        self._at_rest.clear()

    def note_homed(self, park_counts: Mapping[Axis, int]) -> None:
        """Note that all axes are labelled and rest in the park."""
        self._at_rest.update(park_counts)
        self._known = {axis: (n, n) for axis, n in park_counts.items()}
        self._may_be_relabelled = self._may_be_zeroed = self.grasps = False
        self.is_homed = self._is_sure = True

    def note_taken_over(self, counts: Mapping[Axis, int], *, grasps: bool) -> None:
        """Note that the labels of an earlier session hold, and the positions of all axes.

        Parameters
        ----------
        counts : read of all axes at rest
        grasps : the jaws press on something
        """
        self._known = {axis: (n, n) for axis, n in counts.items()}
        self._may_be_relabelled = self._may_be_zeroed = self._is_sure = False
        self._at_rest.clear()
        self.grasps = grasps
        self.is_homed = True

    def note_stop(self, *, is_free: bool) -> None:
        """Note a stop of all axes, whose second board gets it after a hand-over of the line.

        One wrong bit makes define home of a hand-over (`29` and `21`) or of a ramp stop (`25`), so
        counters are compared with what is known before they are trusted again.

        Parameters
        ----------
        is_free : axes may be moved by hand from now on
        """
        self.distrust()
        if is_free:
            self._known.clear()
        self._may_be_relabelled = True

    def note_failure(self, error: BaseException) -> None:
        """Record the reason for the end of a motion."""
        self.note_stop(is_free=False)
        if isinstance(error, LineUncertainError):
            self._may_be_zeroed = self._may_be_zeroed or error.may_have_zeroed

    def distrust(self) -> None:
        """Trust no register until it has been read again."""
        self._is_sure = False
        self._at_rest.clear()

    def note_leaving(self, axes: Iterable[Axis]) -> None:
        """Note that axes are about to move."""
        for axis in axes:
            self._at_rest.pop(axis, None)

    def note_range(self, axis: Axis, first: int, last: int) -> None:
        """Note the range of an axis [counts], or its position if both ends are the same.

        Parameters
        ----------
        axis : the axis
        first, last : ends of the range, in either order [counts]
        """
        self._known[axis] = min(first, last), max(first, last)

    def note_rest(self, counts: Mapping[Axis, int]) -> None:
        """Note that axes rest at their targets [counts]."""
        self._at_rest.update(counts)
        self._known.update({axis: (n, n) for axis, n in counts.items()})

    def note_jaws_driven(self) -> None:
        """Note that the jaws are about to be driven without a target."""
        self.note_leaving([Axis.GRIPPER])
        self._known.pop(Axis.GRIPPER, None)
        self._is_sure = self.grasps = False

    def note_closing(self, end_counts: int) -> None:
        """Note that the jaws are about to close, at most to ``end_counts``."""
        if Axis.GRIPPER in self._known:
            self._known[Axis.GRIPPER] = end_counts, self._known[Axis.GRIPPER][1]

    # ---- what is known -------------------------------------------------------------------------
    def at_rest(self, axis: Axis) -> int | None:
        """Return the target [counts] at which an axis rests; None if it is not known."""
        return self._at_rest.get(axis)

    async def make_sure(self, axes: Axes, guard: Guard) -> None:
        """Read the registers of an arm at rest, and set every target to its axis's position.

        From then on, a go that reaches the wrong axis leaves that axis where it is.

        Raises
        ------
        PositionLostError : the counters are not what they must be, or may have been made zero
        """
        if self._is_sure:
            return
        force = axes.written(Axis.GRIPPER, Parameter.MAX_FORCE)
        axes.forget()
        if self._may_be_relabelled:
            await axes.send_both(Simple.LOAD_DEFAULTS, guard)
            if force is not None:
                await axes.write(Axis.GRIPPER, Parameter.MAX_FORCE, force, guard)
        counts = await self.read(axes)
        for axis in axes_in_turn(axes):
            if not (axis is Axis.GRIPPER and self.grasps):
                await axes.write(axis, Parameter.NEW_POSITION, counts[axis], guard)
        self._at_rest.update(counts)
        self._known = {axis: (n, n) for axis, n in counts.items()}
        self._is_sure = True

    async def read(self, axes: Axes) -> dict[Axis, int]:
        """Return all axes' positions [counts]; check their labels first if these may be wrong.

        Raises
        ------
        PositionLostError : as in `make_sure`
        """
        found = {axis: await axes.read_actual_twice(axis) for axis in axes_in_turn(axes)}
        counts = {axis: found[axis] for axis in Axis}
        if self._may_be_relabelled:
            if why := judge_counters(self._known, counts, self._may_be_zeroed):
                self._on_lost()
                raise PositionLostError(
                    say(
                        "arm: {why} after a fault on its line: positions are no longer "
                        "known; connect and home again",
                        why=why,
                    )
                )
            self._may_be_relabelled = self._may_be_zeroed = False
        return counts


def axes_in_turn(axes: Axes) -> list[Axis]:
    """Return all axes in an order that needs one hand-over of the line."""
    return [axis for ip in axes.ips() for axis in on_ip(Axis, ip)]
