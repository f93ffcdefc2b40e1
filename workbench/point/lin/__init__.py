"""Linear models of any FMU: one method a file, a table of them in `methods`."""
