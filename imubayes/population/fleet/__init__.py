"""Fleets: hundreds or thousands of units of one kind of sensor, each tested, and what they say together."""
