"""`cellctl inspect`, `replay`, `verify`: stored pictures judged, judged again, and verified."""

from .commands import inspect, replay, verify

__all__ = ["inspect", "replay", "verify"]
