"""What a sensor will see, what its errors come to there, and which terms a scene requires."""
