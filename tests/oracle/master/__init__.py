"""The master of co-simulation parts in plain Python: the readable twin of kernel/master.c and control.c."""
