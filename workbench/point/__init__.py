"""An operating point and the linear model there."""
