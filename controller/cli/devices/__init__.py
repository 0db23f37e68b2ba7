"""Devices of a cell: are they all there, and emulated ones for any client."""
