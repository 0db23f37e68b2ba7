"""OPC UA: a server built to OPC 40100-1 (Machine Vision), Basic Vision System Server profile.

Beside it the cell is a machine of OPC 40001-1 (identification, state of the item) and has the
status object of OPC 30050 (PackML). asyncua (LGPL, the extra `opcua`) is imported in this package
alone, which the bridge loads where the cell file asks for it (ADR 126).

`states.py` has the machine; `vision.py` moves it; `methods.py` and `events.py` are what clients
see of it, in the nodes of `space.py` and the records of `values.py`; `door.py` and
`certificates.py` say who comes in; `lean.py` keeps the nodes small.
"""

from .wire import OpcuaWire

__all__ = ["OpcuaWire"]
