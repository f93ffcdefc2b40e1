"""One FMU: archive, description, platforms, and its C functions behind one façade."""
