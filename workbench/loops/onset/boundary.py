"""The boundary in the Nichols chart above which a loop with a rate limiter has to be expected to jump."""

from __future__ import annotations

import numpy as np

__all__ = ["BOUNDARY", "boundary_db"]

# Phase [deg] and gain [dB] of the boundary's corners, as G. Gilbreath (AFIT/GAE/ENY/01M-02, 2001) took them from Duda.
BOUNDARY = ((-180.0, 0.0), (-160.0, 0.0), (-140.0, 1.1), (-120.0, 2.5), (-100.0, 5.5), (-90.0, 7.5), (-60.0, 13.5))


def boundary_db(phase_deg: float) -> float | None:
    """Return the gain of the boundary [dB]; None: it is not published at this phase.

    Args:
        phase_deg: of the open loop with negative feedback, from -360 to 0 [deg].
    """
    phases, gains = zip(*BOUNDARY, strict=True)
    if not phases[0] <= phase_deg <= phases[-1]:
        return None
    return float(np.interp(phase_deg, phases, gains))
