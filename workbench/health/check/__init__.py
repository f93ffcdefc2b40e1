"""The health card of an FMU: one check a file, a table of them in `registry`."""
