"""Best linear approximations: what a linear model is worth at an amplitude, and what it leaves out."""
