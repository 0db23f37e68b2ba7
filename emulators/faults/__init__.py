"""All faults of an emulated cell, as verbs: causes of faults, and the truth.

`Verbs` carries them out on a cell, in the process where it lives or from a control port; a script
gives them beforehand, drawn from a seed. The table of all verbs is docs/emulator-faults.md. The
controller knows none of this.
"""

from ._plant import CameraPlugs, Plant, SupplyChange
from ._script import Script, ScriptError
from ._verbs import Verbs

__all__ = ["CameraPlugs", "Plant", "Script", "ScriptError", "SupplyChange", "Verbs"]
