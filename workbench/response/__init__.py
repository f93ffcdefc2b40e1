"""What a model does under signals."""
