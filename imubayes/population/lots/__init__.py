"""Class-level studies: lots of simulated units of each class, and what a class needs."""
