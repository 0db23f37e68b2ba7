"""Builders of arrays and dataclasses, in mm and rad, from the contents of files.

Import each module by itself, so that a report that needs two cameras loads no planner: `optics`
builds cameras and lamps, `layout` the cell for planning, `planner` everything that plans depend on,
`faces` the faces that are not inspected.
"""
