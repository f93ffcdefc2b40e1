"""Limit cycles of a loop with one nonlinear block: predicted, refined, followed over a parameter, confirmed."""
