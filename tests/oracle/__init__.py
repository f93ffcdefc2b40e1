"""The oracle: sessions in plain readable Python, which the kernel's compiled ones are compared with.

It shares with the package how a session begins, is saved and goes back (`workbench.session.fmu`, `me`), how inputs
are forced and rows are kept, and the loop of co-simulation (`workbench.session.cs`, which the master of systems runs
on). Its own are the loop of model exchange, the solvers, the location of events and their rules. `tests/drivers.py`
puts it in the place of the compiled sessions.
"""
