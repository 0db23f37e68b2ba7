"""The main job, and what comes after it: a run, its end, its report, a recovery."""
