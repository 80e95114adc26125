"""What to test: the best plan of what a bench offers."""
