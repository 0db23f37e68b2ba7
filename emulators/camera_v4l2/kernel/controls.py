"""The camera's controls: their ranges, the effect of a new value, and its events.

Rules are uvcvideo's as observed: a value out of range is clamped silently, a control that an
automatic drives is refused with EACCES, a menu item that does not exist with EINVAL.
"""

import errno
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from . import abi
from .control_specs import ControlFlag, ControlSpec, Kind
from .handle import ClientMemory, Handle, PendingEvent, Refused

_NEXT_CTRL, _NEXT_COMPOUND = 0x80000000, 0x40000000
_CLASS_MASK: Final = 0x0FFF0000
_WHICH_DEFAULT, _WHICH_REQUEST = 0x0F000000, 0x0F010000
_EVENT_ALL, _EVENT_CTRL = 0, 3
_SEND_INITIAL, _ALLOW_FEEDBACK = 1, 4
_CHANGED_VALUE, _CHANGED_FLAGS = 1, 2
_HISTORY_COUNT: Final = 32  # more changes than can be pending at any sensible delay


@dataclass(slots=True)
class _Control:
    spec: ControlSpec
    value: int
    history: list[tuple[int, int]]  # (the first frame taken with it, value), ascending


class ControlBank:
    """Values of all controls, for clients (the last set) and for the sensor (the one in effect)."""

    def __init__(self, specs: Iterable[ControlSpec], monotonic_s: Callable[[], float]) -> None:
        self._controls = {
            spec.cid: _Control(spec, spec.default, [(0, spec.default)]) for spec in specs
        }
        self._monotonic_s = monotonic_s

    def __contains__(self, cid: int) -> bool:
        return cid in self._controls

    def value_set(self, cid: int, default: int = 0) -> int:
        """Return the last value set; `default` if the camera has no such control."""
        control = self._controls.get(cid)
        return default if control is None else control.value

    def value_at(self, cid: int, frame: int, default: int = 0) -> int:
        """Return the value in effect for frame number `frame`.

        Parameters
        ----------
        cid : the control's id
        frame : number of the frame, as the sensor counts them
        default : default for a control that this camera does not have
        """
        control = self._controls.get(cid)
        if control is None:
            return default
        return next(
            (value for first, value in reversed(control.history) if first <= frame),
            control.history[0][1],
        )

    def settle(self) -> None:
        """Let every value take effect at once: no frame is under way."""
        for control in self._controls.values():
            control.history = [(0, control.value)]

    def is_active(self, cid: int, beside: Mapping[int, int] | None = None) -> bool:
        """Return whether the client, not an automatic of the camera, drives a control.

        Parameters
        ----------
        cid : the control's id
        beside : other controls that the same request sets, by id; the automatic may be switched off
            there
        """
        needs = self._controls[cid].spec.needs
        if needs is None:
            return True
        if beside and needs[0] in beside:
            return beside[needs[0]] == needs[1]
        return self.value_set(needs[0], needs[1]) == needs[1]

    def change(
        self, cid: int, value: int, first_frame: int, handles: Iterable[Handle], by: Handle | None
    ) -> bool:
        """Set a checked value from a frame on; return whether a handle has an event to fetch.

        Parameters
        ----------
        cid : the control's id
        value : as `check` returned it
        first_frame : number of the first frame taken with it
        handles : all open files; each gets an event where it has subscribed to one
        by : the file that set it, which gets an event only where it asked for its own; None if no
            file did
        """
        control = self._controls[cid]
        if value == control.value:
            return False
        control.value = value
        self._remember(control, first_frame)
        followers = [
            other for other, c in self._controls.items() if c.spec.needs and c.spec.needs[0] == cid
        ]
        told = False
        for handle in handles:
            told |= self._tell(handle, cid, _CHANGED_VALUE, by)
            for other in followers:
                told |= self._tell(handle, other, _CHANGED_FLAGS, by)
        return told

    def steer(self, cid: int, value: int, first_frame: int) -> None:
        """Set a control as an automatic of the camera does: clamped, and without an event.

        Parameters
        ----------
        cid : the control's id
        value : clamped to the control's range
        first_frame : number of the first frame taken with it
        """
        control = self._controls[cid]
        control.value = max(control.spec.minimum, min(control.spec.maximum, value))
        self._remember(control, first_frame)

    def _remember(self, control: _Control, first_frame: int) -> None:
        earlier = [change for change in control.history if change[0] < first_frame]
        control.history = [*earlier[-_HISTORY_COUNT:], (first_frame, control.value)]

    def _tell(self, handle: Handle, cid: int, changes: int, by: Handle | None) -> bool:
        flags = handle.subscriptions.get(cid)
        if flags is None or (handle is by and not flags & _ALLOW_FEEDBACK):
            return False
        old = handle.events.pop(cid, None)
        if old is not None:
            changes |= old.changes
        control = self._controls[cid]
        spec = control.spec
        payload = abi.EVENT_CTRL.pack(
            changes,
            spec.kind,
            control.value,
            self._flags(spec),
            spec.minimum,
            spec.maximum,
            spec.step,
            spec.default,
        )
        handle.events[cid] = PendingEvent(changes, self._monotonic_s(), handle.events_sent, payload)
        handle.events_sent += 1
        return True

    def _flags(self, spec: ControlSpec) -> int:
        if spec.kind is Kind.CLASS:
            return ControlFlag.READ_ONLY | ControlFlag.WRITE_ONLY
        return 0 if self.is_active(spec.cid) else ControlFlag.INACTIVE

    def _described(self, spec: ControlSpec) -> tuple[int | bytes, ...]:
        """Return the fields common to both kinds of query."""
        limits = (spec.minimum, spec.maximum, spec.step, spec.default)
        return (spec.cid, spec.kind, spec.name.encode()[:31], *limits, self._flags(spec))

    def _find(self, cid: int) -> _Control:
        if cid & _NEXT_CTRL:
            above = [known for known in self._controls if known > cid & 0x0FFFFFFF]
            cid = min(above, default=0)
        elif cid & _NEXT_COMPOUND:
            cid = 0  # there are none
        if cid not in self._controls:
            raise Refused(errno.EINVAL)
        return self._controls[cid]

    def check(self, cid: int, value: int, beside: Mapping[int, int] | None = None) -> int:
        """Return the value set for a client's request, by uvcvideo's rules.

        Parameters
        ----------
        cid : the control's id
        value : the wish
        beside : other controls that the same request sets, by id

        Raises
        ------
        Refused : EACCES, an automatic drives the control, or it is a class; ERANGE or EINVAL, no
            such item of a menu
        """
        spec = self._controls[cid].spec
        if spec.kind is Kind.CLASS or not self.is_active(cid, beside):
            raise Refused(errno.EACCES)
        if spec.kind is Kind.MENU:
            if not spec.minimum <= value <= spec.maximum:
                raise Refused(errno.ERANGE)
            if value not in spec.menu:
                raise Refused(errno.EINVAL)
            return value
        if spec.kind is Kind.BOOLEAN:
            return int(bool(value))
        steps = (max(spec.minimum, min(spec.maximum, value)) - spec.minimum + spec.step // 2) // (
            spec.step
        )
        return min(spec.maximum, spec.minimum + steps * spec.step)

    # -- ioctls ---------------------------------------------------------------------------

    def queryctrl(self, data: bytearray) -> None:
        """Answer VIDIOC_QUERYCTRL."""
        spec = self._find(abi.U32.unpack_from(data)[0]).spec
        data[:] = abi.QUERYCTRL.pack(*self._described(spec))

    def query_ext_ctrl(self, data: bytearray) -> None:
        """Answer VIDIOC_QUERY_EXT_CTRL."""
        spec = self._find(abi.U32.unpack_from(data)[0]).spec
        has_value = spec.kind is not Kind.CLASS
        data[:] = abi.QUERY_EXT_CTRL.pack(*self._described(spec), 4 * has_value, 1 * has_value, 0)

    def querymenu(self, data: bytearray) -> None:
        """Answer VIDIOC_QUERYMENU.

        Raises
        ------
        Refused : EINVAL, no such control or item
        """
        cid, index, _ = abi.QUERYMENU.unpack(data)
        control = self._controls.get(cid)
        if control is None or index not in control.spec.menu:
            raise Refused(errno.EINVAL)
        data[:] = abi.QUERYMENU.pack(cid, index, control.spec.menu[index].encode()[:31])

    def g_ctrl(self, data: bytearray) -> None:
        """Answer VIDIOC_G_CTRL.

        Raises
        ------
        Refused : EINVAL, no such control
        """
        cid = abi.CONTROL.unpack(data)[0]
        control = self._controls.get(cid)
        if control is None or control.spec.kind is Kind.CLASS:
            raise Refused(errno.EINVAL)
        data[:] = abi.CONTROL.pack(cid, control.value)

    def s_ctrl(self, data: bytearray) -> list[tuple[int, int]]:
        """Check VIDIOC_S_CTRL; return the changes for `change`.

        Raises
        ------
        Refused : EINVAL, no such control; otherwise as `check`
        """
        cid, wish = abi.CONTROL.unpack(data)
        if cid not in self._controls or self._controls[cid].spec.kind is Kind.CLASS:
            raise Refused(errno.EINVAL)
        value = self.check(cid, wish)
        data[:] = abi.CONTROL.pack(cid, value)
        return [(cid, value)]

    def ext_ctrls(
        self, request: abi.Request, data: bytearray, memory: ClientMemory | None
    ) -> list[tuple[int, int]]:
        """Answer G/S/TRY_EXT_CTRLS; return the changes for `change`, none of which is made yet.

        Parameters
        ----------
        request : request, one of three
        data : the struct v4l2_ext_controls, answered in place; a refusal puts the index of the bad
            control into it
        memory : access to the array that the struct points at, None where pointers cannot be
            followed

        Raises
        ------
        Refused : ENOTTY, without `memory`; EINVAL, a control or class that does not exist; EACCES,
            a class; otherwise as `check`
        """
        if memory is None:
            raise Refused(errno.ENOTTY)  # no access to the array that the struct points at
        which, count, _, request_fd, reserved, pointer = abi.EXT_CONTROLS.unpack(data)
        if count > len(self._controls):
            raise Refused(errno.EINVAL)
        size = abi.EXT_CONTROL.size
        array = bytearray(memory.fetch(pointer, count * size)) if count else bytearray()
        position, wishes = 0, []
        # uvcvideo looks at the last value of the automatic in the same call, wherever it stands
        beside = _wished(array) if request is abi.Request.S_EXT_CTRLS else None
        try:
            self._check_which(which, count, request)
            for position in range(count):
                cid, room, unused, wish = abi.EXT_CONTROL.unpack_from(array, position * size)
                value = self._ext_value(request, which, cid, wish, beside)
                wishes.append((cid, value))
                abi.EXT_CONTROL.pack_into(array, position * size, cid, room, unused, value)
        except Refused:
            at = position if request is abi.Request.TRY_EXT_CTRLS else count
            data[:] = abi.EXT_CONTROLS.pack(which, count, at, request_fd, reserved, pointer)
            raise
        data[:] = abi.EXT_CONTROLS.pack(which, count, count, request_fd, reserved, pointer)
        if count:
            memory.store(pointer, bytes(array))
        return wishes if request is abi.Request.S_EXT_CTRLS else []

    def _check_which(self, which: int, count: int, request: abi.Request) -> None:
        of_class = which not in (0, _WHICH_DEFAULT)
        known = any(cid & _CLASS_MASK == which & _CLASS_MASK for cid in self._controls)
        defaults_set = which == _WHICH_DEFAULT and request is not abi.Request.G_EXT_CTRLS
        if which == _WHICH_REQUEST or defaults_set or (count == 0 and of_class and not known):
            raise Refused(errno.EINVAL)

    def _ext_value(
        self,
        request: abi.Request,
        which: int,
        cid: int,
        wish: int,
        beside: Mapping[int, int] | None,
    ) -> int:
        control = self._controls.get(cid)
        of_class = which not in (0, _WHICH_DEFAULT)
        if control is None or (of_class and cid & _CLASS_MASK != which & _CLASS_MASK):
            raise Refused(errno.EINVAL)
        if control.spec.kind is Kind.CLASS:
            raise Refused(errno.EACCES)
        if request is abi.Request.G_EXT_CTRLS:
            return control.spec.default if which == _WHICH_DEFAULT else control.value
        return self.check(cid, _signed(wish), beside)

    # -- events ---------------------------------------------------------------------------

    def subscribe_event(self, handle: Handle, data: bytearray) -> bool:
        """Answer VIDIOC_SUBSCRIBE_EVENT; return whether the first event is there already.

        Raises
        ------
        Refused : EINVAL, an event of another kind, or no such control
        """
        kind, cid, flags = abi.EVENT_SUBSCRIPTION.unpack(data)
        if kind != _EVENT_CTRL or cid not in self._controls:
            raise Refused(errno.EINVAL)
        handle.subscriptions[cid] = flags
        if not flags & _SEND_INITIAL or self._controls[cid].spec.kind is Kind.CLASS:
            return False
        return self._tell(handle, cid, _CHANGED_VALUE | _CHANGED_FLAGS, None)

    def unsubscribe_event(self, handle: Handle, data: bytearray) -> None:
        """Answer VIDIOC_UNSUBSCRIBE_EVENT."""
        kind, cid, _ = abi.EVENT_SUBSCRIPTION.unpack(data)
        for known in list(handle.subscriptions) if kind == _EVENT_ALL else [cid]:
            handle.subscriptions.pop(known, None)
            handle.events.pop(known, None)

    def dqevent(self, handle: Handle, data: bytearray) -> None:
        """Answer VIDIOC_DQEVENT with the oldest event.

        Raises
        ------
        Refused : ENOENT, nothing is pending
        """
        if not handle.events:
            raise Refused(errno.ENOENT)
        cid = next(iter(handle.events))
        event = handle.events.pop(cid)
        seconds, fraction = divmod(event.at_monotonic_s, 1.0)
        data[:] = abi.EVENT.pack(
            _EVENT_CTRL,
            event.payload,
            len(handle.events),
            event.sequence,
            int(seconds),
            int(fraction * 1e9),
            cid,
        )


def _wished(array: bytearray) -> dict[int, int]:
    """Return the last value of each control in an array of struct v4l2_ext_control."""
    return {cid: _signed(wish) for cid, _, _, wish in abi.EXT_CONTROL.iter_unpack(array)}


def _signed(wish: int) -> int:
    """Return the 32-bit value in the low half of a control's 64 bits."""
    low_half = wish & 0xFFFFFFFF
    return low_half - (1 << 32) if low_half >> 31 else low_half
