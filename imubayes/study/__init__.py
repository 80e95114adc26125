"""The method, from a study's runs to its verdicts."""
