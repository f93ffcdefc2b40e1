"""Pictures of results; reached through a result's `plot` method."""
