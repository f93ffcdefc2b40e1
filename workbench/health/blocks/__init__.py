"""The blocks that a system can contain, as a list."""
