"""What forces an input: kinds of signals, gusts, as text with units, in files."""
