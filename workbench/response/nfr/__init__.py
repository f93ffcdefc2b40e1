"""Nonlinear frequency response: sine by sine, each point run until its answer has settled."""
