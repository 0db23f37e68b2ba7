"""The settings of one gripper, and its scales between millimetres, newtons and counts."""

from dataclasses import dataclass

from ._registers import FULLY_CLOSED, FULLY_OPEN, Counts


@dataclass(frozen=True, slots=True)
class GripperConfig:
    """A Robotiq 2F-85 as delivered; the two pairs of counts are its two-point calibration.

    Attributes
    ----------
    unit : slave id
    open_mm : opening between the fingertips at ``counts_open`` [mm]
    counts_open, counts_closed : encoder counts fully open, and with the fingertips touching;
        modbus_devices.md 2.5
    min_speed_mm_s, max_speed_mm_s : jaw speed at rSP 0 and 255 [mm/s]
    min_force_n, max_force_n : force of a grasp at rFR 0 and 255 [N]
    default_speed_mm_s, default_force_n : speed and force of a verb that names none
    over_travel_mm : distance by which the target lies beyond the expected opening, so that the part
        and not the target stops the jaws [mm]
    arrival_tolerance_mm : contact this near to the target is arrival, not an obstacle [mm]
    match_tolerance_mm : a part whose contact was not noticed is assumed within this of the
        expected opening [mm]
    slip_tolerance_mm : jaws that move more than this while holding have lost the part or slipped
    keep_alive_s : longest pause between two messages; fault 09 comes after 1 s [cell s]
    hold_poll_s : the same while a part is held, so that its loss is noticed soon [cell s]
    move_poll_s : the same while the jaws move [cell s]
    activation_timeout_s : for one activation; modbus_devices.md 2.6 [cell s]
    spacing_s : least pause between requests; registers are refreshed at 200 Hz [cell s]
    """

    unit: int = 9
    open_mm: float = 85.0
    counts_open: int = 3
    counts_closed: int = 230
    min_speed_mm_s: float = 20.0
    max_speed_mm_s: float = 150.0
    min_force_n: float = 20.0
    max_force_n: float = 235.0
    default_speed_mm_s: float = 80.0
    default_force_n: float = 60.0
    over_travel_mm: float = 8.0
    arrival_tolerance_mm: float = 1.0
    match_tolerance_mm: float = 2.0
    slip_tolerance_mm: float = 1.5
    keep_alive_s: float = 0.4
    hold_poll_s: float = 0.1
    move_poll_s: float = 0.02
    activation_timeout_s: float = 5.0
    spacing_s: float = 0.005

    def __post_init__(self) -> None:
        if not 0 <= self.counts_open < self.counts_closed <= FULLY_CLOSED:
            raise ValueError(
                f"counts must rise from open to closed within 0..255, not "
                f"{self.counts_open} to {self.counts_closed}"
            )
        if not 0 < self.keep_alive_s <= 0.5:
            raise ValueError(f"keep_alive_s must be within 0..0.5 s, not {self.keep_alive_s}")
        if not self.min_speed_mm_s < self.max_speed_mm_s or not self.min_force_n < self.max_force_n:
            raise ValueError("speed and force need a range")
        self.speed_to_byte(self.default_speed_mm_s)
        self.force_to_byte(self.default_force_n)

    @property
    def _mm_per_count(self) -> float:
        return self.open_mm / (self.counts_closed - self.counts_open)

    def counts_to_opening_mm(self, counts: Counts) -> float:
        """Return the opening [mm] at an encoder position; a little beyond the ends is possible."""
        return (self.counts_closed - counts) * self._mm_per_count

    def opening_mm_to_counts(self, opening_mm: float) -> Counts:
        """Return the position to request for an opening [mm].

        The two ends are requested beyond the stops, as the manual's own examples do, so that a
        calibration that is a count off neither leaves a gap nor reports contact with the stop.

        Raises
        ------
        ValueError : the jaws cannot open so far
        """
        if not 0 <= opening_mm <= self.open_mm:
            raise ValueError(f"the jaws open 0..{self.open_mm:g} mm, not {opening_mm:g} mm")
        if opening_mm == self.open_mm:
            return FULLY_OPEN
        if opening_mm == 0:
            return FULLY_CLOSED
        return Counts(round(self.counts_closed - opening_mm / self._mm_per_count))

    def speed_to_byte(self, speed_mm_s: float) -> int:
        """Return rSP for a speed [mm/s]; ValueError outside the gripper's range."""
        return _to_byte(speed_mm_s, self.min_speed_mm_s, self.max_speed_mm_s, "speed", "mm/s")

    def force_to_byte(self, force_n: float) -> int:
        """Return rFR for a force [N]; ValueError outside the gripper's range."""
        return _to_byte(force_n, self.min_force_n, self.max_force_n, "force", "N")


def _to_byte(value: float, low: float, high: float, what: str, unit: str) -> int:
    if not low <= value <= high:
        raise ValueError(f"{what} must be {low:g}..{high:g} {unit}, not {value:g} {unit}")
    return round(255 * (value - low) / (high - low))
