"""Systems: several models connected, which are again a model."""
