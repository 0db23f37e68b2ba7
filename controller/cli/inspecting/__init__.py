"""`cellctl inspect`, `replay`, `verify`: stored pictures judged, once more, and proven."""

from .commands import inspect, replay, verify

__all__ = ["inspect", "replay", "verify"]
