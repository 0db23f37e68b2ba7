"""Name the lamps that light the table and the part in the arm gripper, in the order of use."""

from typing import Final

TABLE_LAMPS: Final = ("table_ring", "table_side")
STATION_LAMPS: Final = ("station_ring", "station_side")
