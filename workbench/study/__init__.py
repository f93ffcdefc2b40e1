"""Studies: analyses on models and systems, over a grid, with requirements on their results."""
