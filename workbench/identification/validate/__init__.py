"""Validation of identified models: one test a file, `validate` puts them together."""
