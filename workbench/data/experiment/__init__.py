"""Recorded experiments: what was measured, read from tables and checked; every step of identification takes one."""
