"""The conformance suite that every driver of `drivers.kinds` has to pass: `pytest --cell FILE`.

`plugin.py` is the pytest plug-in; pytest imports it at every start, so neither it nor this module
imports anything heavy. `requirement.py` has the requirement types, `families.py` the table, one
module each the requirements of a kind of device, `lines.py` disturbances of the line, `bench.py`
the cell around a device, `report.py` the report to sign.
"""
