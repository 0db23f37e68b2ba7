"""Plans, and what is known to be wrong before a run: nothing moves."""
