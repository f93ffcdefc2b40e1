"""Identification experiments: design a signal, run the model, record."""
