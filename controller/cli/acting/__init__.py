"""`cellctl status`, `pause`, `resume`, `step`, `stop`, `abort`, `ack`, `answer`: a running cell."""

from .commands import abort, ack, answer, pause, resume, status, step, stop

__all__ = ["abort", "ack", "answer", "pause", "resume", "status", "step", "stop"]
