"""Speed against accuracy: every rung of the ladder on a study's own data, and on simulated repeats of it."""
