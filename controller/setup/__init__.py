"""From what the files say to what the geometry rooms work with: mm and rad, arrays, dataclasses.

Each module is a door of its own, so that a report that needs two cameras loads no planner:
`optics` builds cameras and lamps, `layout` the cell for planning, `planner` all that plans depend
on, `faces` the faces that are not inspected.
"""
