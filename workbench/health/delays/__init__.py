"""What the master of co-simulation parts costs: delays, the phase lost, the error of its step."""
