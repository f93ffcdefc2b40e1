"""Time histories: run a model under given inputs and record its outputs."""
