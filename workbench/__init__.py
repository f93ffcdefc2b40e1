"""FMI workbench: analyses of FMUs from Python and from the command line.

```python
import workbench as wb

with wb.load("fmu:Rudder") as rudder:
    result = wb.nfr(rudder, "delC", "del", band=(0.5, 20.0), amplitudes=[1.0, 4.0])
result.plot("bode.png")
```

Names are loaded when they are first used, so that importing the package is quick; `__init__.pyi` lists them.
"""

from workbench.core.records.lazy import lazily

__version__ = "1.0.0"

__getattr__, __dir__ = lazily(__name__, __file__, added="workbench.commands:added_functions")
