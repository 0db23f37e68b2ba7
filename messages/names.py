"""Words that sentences take as values, and that no module makes as a sentence.

Names of devices, lamps, signals and trays as cell files have them, kinds of surfaces and features,
reports of the operating system. They stand here so that `pybabel extract` finds them.
"""

from typing import Final

from ._message import key

DEVICES: Final = (
    key("arm"), key("cell"), key("column"), key("controller"), key("elbow"),
    key("fixed gripper body"), key("fixed gripper post"), key("fixture"), key("gripper"),
    key("inspection"), key("io"), key("lights"), key("overhead"), key("scanner"), key("shoulder"),
    key("station panel"), key("table"), key("the table"), key("trays"), key("wrist1"),
    key("wrist2"), key("yaw"), key("zed"),
)  # fmt: skip
LAMPS: Final = (
    key("backlit"), key("station_backlight"), key("station_ring"), key("station_side"),
    key("table_backlight"), key("table_ring"), key("table_side"),
)  # fmt: skip
SIGNALS: Final = (key("estop_ok"), key("guard_closed"), key("supply_ok"))
TRAYS: Final = (key("accept"), key("quarantine"), key("reject"))
SHAPES: Final = (
    key("bore"), key("boss"), key("burrs"), key("chamfer"), key("chips"), key("cone"),
    key("cylinder"), key("depth"), key("fillet"), key("freeform"), key("height"), key("hole"),
    key("keyway"), key("opening"), key("plane"), key("pocket"), key("round"), key("scratches"),
    key("slot"), key("sphere"), key("stains"), key("surface"), key("thickness"), key("through"),
    key("torus"), key("missing"), key("missing_edge"), key("extra"),
)  # fmt: skip
# What people, steps and checks are named by.
WORK: Final = (
    key("aborted"), key("ack"), key("activation"), key("commissioning"), key("connecting"),
    key("controls"), key("cut_off"), key("device"), key("dimension"), key("disk"), key("exposure"),
    key("fixture release"), key("hand off"), key("held"), key("identity"), key("nothing"),
    key("ok"), key("open arm gripper"), key("open fixed gripper"), key("operator"), key("pictures"),
    key("place in tray"), key("planner"), key("planning"), key("recipe"), key("recognised"),
    key("recognising"), key("stalled"), key("stopped"), key("stored"), key("take back"),
)  # fmt: skip
# How things are listed.
LISTS: Final = (
    key("{0} and {1}"), key("{0} or {1}"), key("{0} and {1} and {2}"), key("{0} or {1} or {2}"),
)  # fmt: skip
QUANTITIES: Final = (
    key("below"), key("deeper"), key("deg"), key("higher"), key("no"), key("others"), key("press"),
    key("tried"),
)  # fmt: skip
# Of the operating system, as Python has them.
OPERATING_SYSTEM: Final = (
    key("Broken pipe"), key("Connection refused"), key("Connection reset by peer"),
    key("Device or resource busy"), key("Input/output error"), key("Network is unreachable"),
    key("No route to host"), key("No space left on device"), key("No such device"),
    key("No such file or directory"), key("Permission denied"), key("Read-only file system"),
    key("database is locked"), key("dequeue"), key("over-current"),
)  # fmt: skip
