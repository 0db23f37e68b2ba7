"""The fault policy at work: `recoveries.py` on part faults, `retries.py` on devices."""

from .recoveries import Recoveries, RecoveryAction, fault_policy, faults_section
from .retries import Retries

__all__ = ["Recoveries", "RecoveryAction", "Retries", "fault_policy", "faults_section"]
