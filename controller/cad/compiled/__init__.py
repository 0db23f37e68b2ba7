"""Everything that follows from a part alone, computed once and kept in one file."""
