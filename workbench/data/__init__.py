"""Records before a model is fitted."""
