"""The outline of a solid in loops, as lines and arcs."""
