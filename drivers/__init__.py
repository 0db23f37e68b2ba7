"""Drivers of the cell's devices: one folder per family, each speaking its device's own protocol.

A driver knows its device and nothing else of ours: no part, no recipe, no other device. Shared code
is beside this file: the errors (`errors`), the clock (`clock`) and the Modbus bus (`modbus_link`).
"""
