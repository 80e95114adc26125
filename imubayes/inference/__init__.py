"""What the runs say: noise, whitening, the triangular factor, posterior moments, residual checks."""
