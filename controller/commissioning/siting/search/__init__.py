"""Which sites are worth checking: grids about the arm, ranked by its joints, then small steps."""
