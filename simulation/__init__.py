"""Controller, drivers, devices and world in one process, on one virtual clock, from one seed.

For tests and benchmarks alone; nothing else imports it. `loop.py` is the event loop, `wires.py` the
byte queues, `cell.py` the cell and its controllers.
"""
