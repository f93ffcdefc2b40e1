"""Rational models from measured frequency responses."""
