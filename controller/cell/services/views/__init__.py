"""What the cameras see of the part: views and their results, how it is held, what it is.

`views.py` has views judged in the worker process, `held_pose.py` measures how the arm gripper holds
the part, `disambiguation.py` decides between hypotheses, `holder.py` has the boxes of arm and
grippers that may hide the part.
"""

from .disambiguation import Disambiguation
from .held_pose import HeldPose
from .holder import holder_boxes
from .views import Views

__all__ = [
    "Disambiguation",
    "HeldPose",
    "Views",
    "holder_boxes",
]
