"""The faults of the camera and of its cable, as ordinary inputs of a test or of a control port."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """Faults in force; counts run down by themselves. Unplugging is the device's own verb.

    Attributes
    ----------
    lost_packet_count : so many payload packets to come are lost, every other one; they can be
        requested again
    lost_per_thousand : so many of all stream packets are lost by chance, those sent again too
    mtu_bytes : a switch passes no larger packet; 0 for any size
    short_count : so many frames to come end half-way, and the rest cannot be requested again
    lost_count : so many frames to come are lost in the camera: their numbers are used up
    missed_trigger_count : so many triggers to come are passed over, without a trace
    is_stalled : no frame is exposed until this is taken back
    is_frozen : frames come in time and numbered, with the same old picture in them
    is_dark : no light reaches the sensor: a cap is on the lens
    late_count : so many frames to come are sent late, each with the time of its exposure
    late_s : by how much [world s]
    held_by : address of another host that controls the camera, as ``192.0.2.7``; empty for none
    is_mute : no request is answered
    """

    lost_packet_count: int = 0
    lost_per_thousand: int = 0
    mtu_bytes: int = 0
    short_count: int = 0
    lost_count: int = 0
    missed_trigger_count: int = 0
    is_stalled: bool = False
    is_frozen: bool = False
    is_dark: bool = False
    late_count: int = 0
    late_s: float = 0.5
    held_by: str = ""
    is_mute: bool = False
