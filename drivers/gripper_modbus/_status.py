"""One reading of the gripper, in millimetres, and its meaning for a part.

Sections (§) are those of modbus_devices.md.
"""

from dataclasses import dataclass
from enum import Enum

from messages import say

from ..kinds import Hold
from ._config import GripperConfig
from ._registers import (
    NO_MESSAGE_FAULT,
    ActivationState,
    Counts,
    FaultClass,
    Inputs,
    ObjectState,
    fault_of,
)


@dataclass(frozen=True, slots=True)
class GripperStatus:
    """One reading of the gripper.

    Attributes
    ----------
    at_s : cell instant just before the request: the reading is not older [s]
    is_powered_on : gACT, false after a power loss until the next activation
    is_going : gGTO, whether it has an order to go to ``requested_counts``
    activation : gSTA
    object : gOBJ; no meaning unless ``is_going``
    fault, controller_fault : gFLT and kFLT; 0 is none
    requested_counts, position_counts : gPR and gPO
    opening_mm : opening between the fingertips [mm]
    current_ma : current of the motor [mA]
    """

    at_s: float
    is_powered_on: bool
    is_going: bool
    activation: ActivationState
    object: ObjectState
    fault: int
    controller_fault: int
    requested_counts: Counts
    position_counts: Counts
    opening_mm: float
    current_ma: int

    @classmethod
    def of(cls, inputs: Inputs, config: GripperConfig, at_s: float) -> "GripperStatus":
        """Return the status in the registers.

        Parameters
        ----------
        inputs : the input registers, read in one request
        config : the calibration that turns counts into an opening
        at_s : time of the readings [cell s]
        """
        return cls(
            at_s=at_s,
            is_powered_on=inputs.activation_echo,
            is_going=inputs.go_to_echo,
            activation=inputs.activation,
            object=inputs.object,
            fault=inputs.fault,
            controller_fault=inputs.controller_fault,
            requested_counts=inputs.requested,
            position_counts=inputs.position,
            opening_mm=config.counts_to_opening_mm(inputs.position),
            current_ma=inputs.current_ma,
        )

    @property
    def is_activated(self) -> bool:
        """Whether it can be moved without activating it first."""
        return self.is_powered_on and self.activation is ActivationState.ACTIVE

    @property
    def has_fault(self) -> bool:
        """Whether a fault prevents a move.

        09 does not: it shows after an idle second, and the message that reads it ends it.
        """
        return fault_of(self.fault).kind is not FaultClass.NONE and self.fault != NO_MESSAGE_FAULT

    @property
    def is_moving(self) -> bool:
        """Whether the jaws are moving."""
        return self.is_going and self.object is ObjectState.MOVING

    @property
    def has_contact(self) -> bool:
        """Whether an object stopped the jaws in their last move."""
        contacts = (ObjectState.CONTACT_CLOSING, ObjectState.CONTACT_OPENING)
        return self.is_going and self.object in contacts

    @property
    def has_arrived(self) -> bool:
        """Whether the jaws' last move met nothing."""
        return self.is_going and self.object is ObjectState.AT_POSITION

    @property
    def fault_text(self) -> str:
        """The fault in words, with advice."""
        fault = fault_of(self.fault)
        return say(
            "fault {fault:02X}, {text}: {advice}",
            fault=self.fault,
            text=fault.text,
            advice=fault.advice,
        )


class GraspEvidence(Enum):
    """The evidence for a part between the jaws."""

    NONE = "none"
    CONTACT = "contact"  # gOBJ reported it
    OPENING = "opening"  # gOBJ missed it, but the jaws stand at the expected opening


@dataclass(frozen=True, slots=True)
class GraspResult:
    """The result of a grasp. An empty one is a result, not an error.

    Attributes
    ----------
    object_detected : True if something is between the jaws
    opening_mm : opening between the fingertips [mm]
    evidence : evidence behind ``object_detected``
    status : the reading it was judged by
    """

    object_detected: bool
    opening_mm: float
    evidence: GraspEvidence
    status: GripperStatus


def judge_grasp(
    status: GripperStatus, contact: ObjectState, expected_mm: float, config: GripperConfig
) -> GraspResult:
    """Return the end of a grasping move, judged by gOBJ *and* gPO (modbus_devices.md 2.3).

    Parameters
    ----------
    status : the reading at the end of the move
    contact : gOBJ when the part stops the jaws in this direction
    expected_mm : opening on the part; 0 when unknown [mm]
    config : calibration, and tolerances of the opening
    """
    evidence = GraspEvidence.NONE
    if status.object is contact:
        touch_each_other = (
            contact is ObjectState.CONTACT_CLOSING
            and status.position_counts >= config.counts_closed
        )
        if not touch_each_other:
            evidence = GraspEvidence.CONTACT
    elif expected_mm > 0 and status.object is ObjectState.AT_POSITION:
        requested_mm = config.counts_to_opening_mm(status.requested_counts)
        is_short_of_request = abs(status.opening_mm - requested_mm) > config.over_travel_mm / 2
        is_at_part = abs(status.opening_mm - expected_mm) <= config.match_tolerance_mm
        if is_short_of_request and is_at_part:
            evidence = GraspEvidence.OPENING
    return GraspResult(evidence is not GraspEvidence.NONE, status.opening_mm, evidence, status)


def judge_hold(grasp: GraspResult | None, status: GripperStatus, config: GripperConfig) -> Hold:
    """Return whether the part of a grasp is still held.

    Parameters
    ----------
    grasp : result of the last `close_on` or `open_on`; None when the jaws have been moved since
    status : the reading to judge
    config : gives ``slip_tolerance_mm``, how far the opening may have changed since
    """
    if grasp is None or not grasp.object_detected:
        return Hold.NOTHING
    if not status.is_activated:
        return Hold.UNKNOWN
    if abs(status.opening_mm - grasp.opening_mm) > config.slip_tolerance_mm:
        return Hold.LOST
    if not status.is_going:
        return Hold.HELD  # stopped fingers hold; gOBJ means nothing now
    if status.object is ObjectState.MOVING:
        return Hold.UNKNOWN
    if status.object is ObjectState.AT_POSITION and grasp.evidence is GraspEvidence.CONTACT:
        return Hold.LOST  # "at position, or the object was lost", §2.3
    return Hold.HELD
