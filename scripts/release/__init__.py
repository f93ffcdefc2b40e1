"""Making a release: `python scripts/dev.py release`."""
