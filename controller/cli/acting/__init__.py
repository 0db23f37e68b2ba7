"""`cellctl status`, `watch`, `pause`, `resume`, `step`, `stop`, `abort`, `ack`, `answer`."""

from .commands import abort, ack, answer, pause, resume, status, step, stop, watch

__all__ = ["abort", "ack", "answer", "pause", "resume", "status", "step", "stop", "watch"]
