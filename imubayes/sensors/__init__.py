"""What is tested: the model's terms, the catalogue of technologies and grades, noise processes."""
