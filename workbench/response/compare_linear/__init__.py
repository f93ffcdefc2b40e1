"""Linear models beside measured responses."""
