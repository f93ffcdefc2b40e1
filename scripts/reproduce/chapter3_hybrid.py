"""Kalman and Bertram's merging of sampled and continuous parts: chapter 3.1.3 of the source report."""

from __future__ import annotations

from scripts.reproduce.measurement import Measurement, Reproduction
from workbench.point.lin.request import lin
from workbench.system.connect import connect
from workbench.system.description import Connection
from workbench.system.load import load

__all__ = ["EXPERIMENTS"]


def _hybrid() -> Measurement:
    """Linearise a sampled law with a continuous lag behind it, and two samplers of different rates."""
    wire = Connection(source="law.elevator", destination="lag.u", convert=False)
    with load("fmu:ElevatorLaw", "me") as law, load("fmu:FirstOrderLag", "me") as lag:
        stick, y = {"stick": "law.side_stick"}, {"y": "lag.y"}
        with connect({"law": law, "lag": lag}, [wire], inputs=stick, outputs=y) as both:
            r = lin(both, inputs=["stick"], outputs=["y"]).result
    with load("fmu:TwoRateQuantizer", "me") as two:
        period = lin(two).result.dt
    k = r.state_names.index("lag.x")
    return Measurement(
        {"hybrid-transition": [r.A[k, k], r.B[k, 0], r.C[0, k], r.D[0, 0]], "hybrid-period": period},
        {"hybrid-transition": "; ".join(r.notes[:1])},
    )


EXPERIMENTS = (Reproduction("hybrid system", ("hybrid-transition", "hybrid-period"), _hybrid),)
