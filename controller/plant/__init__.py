"""The cell in a factory: what it tells a plant system, and what it takes from one.

`cellctl connect` is one resident process beside the cell. It reads the journal and the control
socket, starts runs as the page does, and may end or be killed at any time: the cell does not notice
(ADR 123). `model.py` has the payloads, the same on every wire; `folding.py` makes them from the
journal; `outbox.py` sees that each is delivered; `orders.py` takes orders; `bridge.py` puts these
together for `wires/`, which know no cell. `keeping.py` keeps the runs' pictures as the cell asks.
"""
