"""An emulated cell: devices on real wires over one world, in a process of its own.

Nothing here is shared with `drivers` or `controller`: every manual is read a second time, so
that a misreading shows as a disagreement.
"""
