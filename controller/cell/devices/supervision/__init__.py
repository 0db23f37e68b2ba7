"""The supervisor of a run, from the controller's side: heartbeat, orders, reports."""

from .supervised import Callers, Supervised

__all__ = ["Callers", "Supervised"]
