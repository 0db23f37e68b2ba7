"""The control socket, by which another terminal or program acts on a running cell.

HTTP over a unix socket of the same user. `words.py` has the messages, `client.py` sends requests,
`place.py` has the socket's path, `peer.py` the identity of the peer; `serving` is the run's end. It
reads and acts through the dispatcher alone.
"""

from .client import NoRunError, NotServedError, RunningCell
from .place import ControlError, make_folder, socket_path
from .standing import StandingReply, left_in_grippers, standing_of
from .words import (
    MAX_KEY,
    MAX_WHO,
    MAX_WHY,
    AckOrder,
    AnswerOrder,
    DecisionReply,
    Order,
    PauseOrder,
    QuestionReply,
    ResumeOrder,
    StatusReply,
    facts,
)

__all__ = [
    "MAX_KEY",
    "MAX_WHO",
    "MAX_WHY",
    "AckOrder",
    "AnswerOrder",
    "ControlError",
    "DecisionReply",
    "NoRunError",
    "NotServedError",
    "Order",
    "PauseOrder",
    "QuestionReply",
    "ResumeOrder",
    "RunningCell",
    "StandingReply",
    "StatusReply",
    "facts",
    "left_in_grippers",
    "make_folder",
    "socket_path",
    "standing_of",
]
