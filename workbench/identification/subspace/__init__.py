"""Subspace identification (the source report's `sds`)."""
