"""The supervisor of a run, from the controller's side: heartbeat, orders, reports."""

from .supervised import CallerPrograms, Supervised

__all__ = ["CallerPrograms", "Supervised"]
