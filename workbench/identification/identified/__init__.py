"""Models that identification finds, and what is computed of them."""
