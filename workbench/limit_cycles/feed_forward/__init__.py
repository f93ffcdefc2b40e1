"""Feed-forward of a nonlinear block's output: the filter F = H/G, made stable and small, and what it does."""
