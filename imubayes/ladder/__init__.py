"""The rungs of the ladder as functions with one interface."""
