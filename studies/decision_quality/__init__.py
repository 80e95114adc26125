"""How good the decision is: simulated sensors with known truth, every method on each, and their scores."""
