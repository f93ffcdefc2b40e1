"""One plug-in of each kind for the FMI workbench."""
