"""The cameras' views of the part: their results, its hold, its identity.

`views.py` has views judged in the worker process, `held_pose.py` measures how the arm gripper holds
the part, `disambiguation.py` decides between hypotheses, `part_file.py` writes the views of a part
to a file, `judging_ahead.py` judges them as far as that can be done before the last one is shown.
"""

from .disambiguation import Disambiguation
from .held_pose import HeldPose
from .judging import Background
from .judging_ahead import JudgingAhead
from .part_file import PartFileWriter
from .stored_views import StoredViews
from .views import Views, plain_name

__all__ = [
    "Background",
    "Disambiguation",
    "HeldPose",
    "JudgingAhead",
    "PartFileWriter",
    "StoredViews",
    "Views",
    "plain_name",
]
