"""The controller's three ports: state (RTDE), power and safety (dashboard), motion (script)."""

from ._dashboard import Dashboard
from ._rtde import RtdePort, UrState
from ._script import ScriptPort
from ._stream import Stream, open_stream

__all__ = ["Dashboard", "RtdePort", "ScriptPort", "Stream", "UrState", "open_stream"]
