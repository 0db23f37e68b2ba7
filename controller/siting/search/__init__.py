"""Find sites worth checking: grids about the arm, ranked by its joints, then small steps."""
