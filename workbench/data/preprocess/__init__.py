"""Pre-processing of recorded data: each step returns new data and says what was done."""
