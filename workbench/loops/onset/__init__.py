"""Rate-limit onset of a loop: where a limiter begins to act, and whether the loop then jumps."""
