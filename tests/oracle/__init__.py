"""The oracle: sessions in plain readable Python, which the kernel's compiled ones are compared with.

It shares with the package how a session begins, is saved and goes back (`workbench.session.fmu`, `me`, `cs`), and what
its inputs are. Its own are both loops and how inputs are forced in them, the rows, the solvers, the location of events
and their rules. `tests/drivers.py` puts it in the place of the compiled sessions.
"""
