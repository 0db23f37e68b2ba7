"""The supervisor of a run, from the controller's side: heartbeat, orders, what it reports."""

from .supervised import Supervised

__all__ = ["Supervised"]
