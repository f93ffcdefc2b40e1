"""Loops of systems: opened at a connection, their transfer, margins, and what sines of some amplitude see of them."""
