"""Turn the contents of files into what the geometry rooms need: arrays and dataclasses, mm and rad.

Import each module by itself, so that a report that needs two cameras loads no planner: `optics`
builds cameras and lamps, `layout` the cell for planning, `planner` everything that plans depend on,
`faces` the faces that are not inspected.
"""
