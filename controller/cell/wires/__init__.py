"""All wires of a run in one file, and a run played back from it (docs/wires.md, ADR 46).

`file.py` writes and reads the file, `recording.py` is the tap that fills it. `playing.py` answers
drivers from it and finds the first difference: `lines.py` for lines of bytes, `cameras.py` for
cameras, `loop.py` is the event loop on the recording's time. `replaying.py` runs a batch on these.
"""

from drivers.wire_file import WireFileError, WireReader, WireWriter

from .lines import Difference
from .recording import Recorder
from .replaying import Replayed, inputs_of, replay_wires

__all__ = [
    "Difference",
    "Recorder",
    "Replayed",
    "WireFileError",
    "WireReader",
    "WireWriter",
    "inputs_of",
    "replay_wires",
]
