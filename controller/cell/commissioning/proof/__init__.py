"""What a verification tries with the plate: a hand-off there and back, and its known lengths."""

from .hand_off import HandOff, hand_off_and_back
from .lengths import LengthStudy, length_study

__all__ = ["HandOff", "LengthStudy", "hand_off_and_back", "length_study"]
