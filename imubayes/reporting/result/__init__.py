"""What a study came to, as it is published: one frozen type in SI, written and read by one adapter."""
