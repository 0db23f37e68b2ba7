"""Name the lamps of table and station: those that light the part, in the order of use, and panels.

A panel stands behind the part, so that its outline shows.
"""

from typing import Final

TABLE_LAMPS: Final = ("table_ring", "table_side")
STATION_LAMPS: Final = ("station_ring", "station_side")
TABLE_PANEL: Final = "table_backlight"
STATION_PANEL: Final = "station_backlight"
