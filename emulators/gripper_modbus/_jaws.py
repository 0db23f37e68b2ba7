"""The jaws of a parallel gripper: their opening, their stops, and their force.

Figures are a Robotiq 2F-85's: modbus_devices.md 2.5. Time is handed in; where a part stands
between the jaws comes from the world.
"""

from dataclasses import dataclass
from typing import Final

STROKE_MM: Final = 85.0
MIN_SPEED_MM_PER_S: Final = 20.0
MAX_SPEED_MM_PER_S: Final = 150.0
MIN_FORCE_N: Final = 20.0
MAX_FORCE_N: Final = 235.0
TOUCH_MM: Final = 0.01  # a smaller gap counts as contact
# time from touching to the requested force (typical, not from the manual)
FORCE_RISE_S: Final = 0.03


@dataclass(slots=True)
class JawModel:
    """Two jaws driven by one motor through a self-locking gear.

    Attributes
    ----------
    opening_mm : distance of the jaws
    target_mm : target of the jaws
    speed_mm_per_s : speed of both jaws together
    force_limit_n : force limit of the jaws
    is_driven : True if the motor runs; if not, jaws stay in place and keep what they hold
    grasp_limit_mm : width of what stands between the jaws, set by the world before each step;
        None: nothing there
    inner_limit_mm : opening at which the jaws touch a part from inside; None: nothing there
    jammed : the fingers do not move, whatever the motor does, which it cannot tell from contact
    force_n : force on what the jaws touch
    current_ma : current of the motor
    closing_current_ma, opening_current_ma : current of free motion, as in the manual's printed
        status frames (modbus_devices.md 2.7)
    current_ma_per_n : current while the force is building up
    stroke_mm : largest opening
    """

    opening_mm: float = STROKE_MM
    target_mm: float = STROKE_MM
    speed_mm_per_s: float = MAX_SPEED_MM_PER_S
    force_limit_n: float = MIN_FORCE_N
    is_driven: bool = False
    grasp_limit_mm: float | None = None
    inner_limit_mm: float | None = None
    jammed: bool = False
    force_n: float = 0.0
    current_ma: float = 0.0
    closing_current_ma: float = 100.0
    opening_current_ma: float = 160.0
    current_ma_per_n: float = 3.0
    stroke_mm: float = STROKE_MM

    @property
    def touches_while_closing(self) -> bool:
        """Whether something between the jaws keeps them from closing on."""
        if self.target_mm >= self.opening_mm - TOUCH_MM:
            return False
        limit_mm = self.grasp_limit_mm
        return self.jammed or (limit_mm is not None and self.opening_mm <= limit_mm + TOUCH_MM)

    @property
    def touches_while_opening(self) -> bool:
        """Whether a part around the jaws keeps them from opening on."""
        if self.target_mm <= self.opening_mm + TOUCH_MM:
            return False
        limit_mm = self.inner_limit_mm
        return self.jammed or (limit_mm is not None and self.opening_mm >= limit_mm - TOUCH_MM)

    @property
    def is_pressing(self) -> bool:
        """Whether the jaws press on a part, from outside or inside."""
        return self.touches_while_closing or self.touches_while_opening

    @property
    def is_holding(self) -> bool:
        """Whether the jaws press with all the force asked for."""
        return self.force_n > 0.0 and self.force_n >= self.force_limit_n

    @property
    def is_at_target(self) -> bool:
        """Whether the jaws are where they were sent."""
        return abs(self.target_mm - self.opening_mm) <= TOUCH_MM

    def drive(self, target_mm: float, speed_mm_per_s: float, force_limit_n: float) -> None:
        """Send the jaws to an opening.

        Parameters
        ----------
        target_mm : the opening; limited to the stroke of the mechanism
        speed_mm_per_s : speed of the opening, both jaws together
        force_limit_n : the force at which they stop pressing harder
        """
        self.target_mm = min(max(target_mm, 0.0), self.stroke_mm)
        self.speed_mm_per_s = speed_mm_per_s
        self.force_limit_n = force_limit_n
        self.is_driven = True

    def stop(self) -> None:
        """Stop the motor; the gear holds."""
        self.is_driven = False
        self.current_ma = 0.0

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        if not self.is_driven:
            if self.force_n and not self.is_pressing:
                self.force_n = 0.0  # what was held is gone, and no motor follows it
            return
        away_mm = self.target_mm - self.opening_mm
        if not self.jammed and away_mm:
            self.opening_mm += self._free_way_mm(away_mm, self.speed_mm_per_s * dt_s)
        self._press(dt_s, away_mm)

    def _free_way_mm(self, away_mm: float, reach_mm: float) -> float:
        if away_mm < 0.0:
            way_mm = max(away_mm, -reach_mm)
            if self.grasp_limit_mm is not None:
                way_mm = min(0.0, max(way_mm, self.grasp_limit_mm - self.opening_mm))
            return way_mm
        way_mm = min(away_mm, reach_mm)
        if self.inner_limit_mm is not None:
            way_mm = max(0.0, min(way_mm, self.inner_limit_mm - self.opening_mm))
        return way_mm

    def _press(self, dt_s: float, away_mm: float) -> None:
        if self.is_pressing:
            if self.force_n < self.force_limit_n:
                force_rise_n = self.force_limit_n * dt_s / FORCE_RISE_S
                self.force_n = min(self.force_n + force_rise_n, self.force_limit_n)
                self.current_ma = self.force_n * self.current_ma_per_n
            else:
                self.force_n = self.force_limit_n
                self.current_ma = 0.0  # the gear holds, the motor rests
            return
        self.force_n = 0.0
        if self.is_at_target:
            self.current_ma = 0.0
        else:
            self.current_ma = self.closing_current_ma if away_mm < 0.0 else self.opening_current_ma
