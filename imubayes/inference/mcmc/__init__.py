"""Posteriors by Markov chains: two samplers on one log density."""
