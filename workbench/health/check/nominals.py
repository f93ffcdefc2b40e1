"""Are the nominal values of the states of the size that the states have?"""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.session.fmu import FmuSession

__all__ = ["nominals"]

# Sizes may differ by so much from the nominal value: a test run is short and its inputs small.
_FAR = 1e4
_ROUNDING = 1e-13  # of the nominal value


def nominals(subject: CheckedFmu) -> Answer:
    """Compare each state's nominal value with its largest magnitude in a test run.

    The solvers take tolerance·nominal as the error that they allow in a state. A nominal value 10⁴ times too large
    leaves a state unresolved, one too small costs steps without end; that far off is watch. Small states are no
    evidence by themselves: a state that stays below tolerance·nominal is told only if it moves (by more
    than rounding). Broken: not positive,
    not finite (FMI 2.0.4 section 3.2.1 demands positive ones). States without a declared nominal value (or with 1,
    the default) are followed by the workbench's own scale and only told. Not applicable: no states.
    """
    with subject.model.open_session(start_time=subject.start) as session:
        instance = session.instance
        if not instance.nx:
            return Answer("not applicable", "no continuous states")
        nominal = instance.get_nominals().copy()
        names = _names(subject, instance.nx)
        bad = np.flatnonzero(~(np.isfinite(nominal) & (nominal > 0.0)))
        if len(bad):
            first = int(bad[0])
            text = (
                f"nominal value of {names[first]} is {nominal[first]:g}; {len(bad)} of {instance.nx} are not positive"
            )
            return Answer("broken", text, "1 is used instead; the accuracy of these states is unknown")
        largest, moves = _seen(subject, session)
    return _judge(subject, names, nominal, largest, moves)


def _names(subject: CheckedFmu, count: int) -> list[str]:
    states = subject.model.states
    return [v.name for v in states] if len(states) == count else [f"state[{i}]" for i in range(1, count + 1)]


def _seen(subject: CheckedFmu, session: FmuSession) -> tuple[Floats, Floats]:
    """Return largest magnitude and range of each state in a test run, shape (n,) each."""
    rows, signals = [], subject.sines()
    for point in subject.points():
        session.advance(float(point), signals=signals)
        session.instance.get_states()
        rows.append(session.instance.x.copy())
    x = np.array(rows)
    return np.abs(x).max(axis=0), np.ptp(x, axis=0)


def _judge(subject: CheckedFmu, names: list[str], nominal: Floats, largest: Floats, moves: Floats) -> Answer:
    declared = np.array([n != 1.0 for n in nominal])
    ratio = largest / nominal
    rtol = subject.model.recipe.tolerance or subject.model.description.experiment.tolerance or 1e-6
    large = ratio > _FAR
    lost = (moves > _ROUNDING * nominal) & (largest < rtol * nominal)
    off = np.flatnonzero((large | lost) & declared)
    seen = ratio[largest > 0.0]
    reach = f"{seen.min():.2g} … {seen.max():.2g}" if len(seen) else "all at 0"
    numbers = {"ratio": dict(zip(names, ratio.tolist(), strict=True)), "declared": int(declared.sum())}
    if not len(off):
        undeclared = int((~declared).sum())
        tail = f"; {undeclared} left at the default 1" if undeclared else ""
        return Answer("good", f"{len(names)} states, magnitude over nominal value {reach}{tail}", numbers=numbers)
    worst = int(off[np.argmax(np.abs(np.log10(np.maximum(ratio[off], 1e-300))))])
    text = f"{names[worst]} reaches {largest[worst]:.3g}, its nominal value is {nominal[worst]:.3g}"
    more = f" (and {len(off) - 1} more)" if len(off) > 1 else ""
    advice = "integration errors are scaled wrongly: use a tighter `tolerance` and compare"
    return Answer("watch", text + more, advice, numbers)
