"""What a test can tell, before and after it is run."""
