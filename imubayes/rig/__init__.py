"""How it is tested: inputs, procedures, recorded runs and simulated ones."""
