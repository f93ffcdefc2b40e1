"""The blocks that a system can contain: one class each, from which all that knows blocks is derived."""
