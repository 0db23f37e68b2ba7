"""GigE Vision on the wire: packets of control and stream, and where bootstrap registers are."""
