"""The component equations of the IEEE standards, and their mapping to the generalized coefficients."""
