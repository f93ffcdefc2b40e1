"""Scalar output feedback on a system: gains that stabilise it, poles along the gain, limit cycles left, settling."""
