"""The compiled inner loop: one call advances many steps, for every FMI version and interface."""
