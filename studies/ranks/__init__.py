"""Whether the posterior is calibrated: ranks of simulated truths among its draws."""
