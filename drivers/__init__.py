"""Drivers of the cell's devices: one folder per family, each speaking its device's own protocol.

A driver knows its device and nothing else of ours: no part, no recipe, no other device.
What all of them share stands beside this file: the errors (`errors`), the clock (`clock`)
and the Modbus bus (`modbus_link`).
"""
