"""Tables and bytes of the controller's ports; no link, no clock.

Sections (§) are those of ur.md.
"""

from .messages import MessageReader, message_text
from .modes import (
    AT_ONCE,
    OPERATES,
    PAUSED,
    PAUSES,
    PLAYING,
    RobotMode,
    SafetyMode,
    advice,
    mode_words,
    safety_words,
)
from .rtde import (
    OPTIONAL_FIELDS,
    REQUIRED_FIELDS,
    Package,
    PackageReader,
    PackageType,
    Recipe,
    decode_accepted,
    decode_recipe,
    decode_text,
    decode_version,
    encode_outputs,
    encode_request,
    encode_version,
)
from .script import freedrive, movej, set_payload, set_tcp, stopj

__all__ = [
    "AT_ONCE",
    "OPERATES",
    "OPTIONAL_FIELDS",
    "PAUSED",
    "PAUSES",
    "PLAYING",
    "REQUIRED_FIELDS",
    "MessageReader",
    "Package",
    "PackageReader",
    "PackageType",
    "Recipe",
    "RobotMode",
    "SafetyMode",
    "advice",
    "decode_accepted",
    "decode_recipe",
    "decode_text",
    "decode_version",
    "encode_outputs",
    "encode_request",
    "encode_version",
    "freedrive",
    "message_text",
    "mode_words",
    "movej",
    "safety_words",
    "set_payload",
    "set_tcp",
    "stopj",
]
