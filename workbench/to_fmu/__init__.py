"""What becomes an FMU: linear models and systems."""
