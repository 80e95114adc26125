"""Triangular factors of whitened rows, and the digits that their arithmetic keeps."""
