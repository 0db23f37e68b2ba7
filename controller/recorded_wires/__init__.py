"""All wires of a run in one file, and a run played back from it (docs/wires.md, ADR 46).

`recording.py` is the tap that fills the file (`drivers.wire_file`). `lines.py` and `cameras.py`
answer drivers from it and find the first difference, `loop.py` is the event loop on the
recording's time. `replaying.py` runs a batch on these.
"""

from drivers.wire_file import WireFileError, WireReader, WireWriter

from .lines import Difference
from .recording import Recorder, require_recorded
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
    "require_recorded",
]
