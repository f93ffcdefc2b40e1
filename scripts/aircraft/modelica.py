"""Writes the calibrated aircraft as a Modelica model whose data is read by people, too."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from string import Template

import numpy as np

from scripts.aircraft.data import POINTS, Aircraft
from workbench.core.values.arrays import Floats

TEMPLATE = Path(__file__).with_name("Aircraft.mo.in")
SURFACES = ("elevator", "inner_aileron", "outer_aileron")


OUTPUT = '  output Real {name}{suffix}(unit = "{unit}") "{text}";\n'


def source(aircraft: Aircraft) -> str:
    """Return the text of Aircraft.mo."""
    nominal = np.r_[np.full(3, 10.0), np.full(27, 1.0), np.full(3, 0.01)]
    speed = nominal * np.maximum(2.0 * np.pi * np.r_[aircraft.hertz, np.full(3, 3.0)], 1.0)
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        outputs=_outputs(),
        airspeed=aircraft.airspeed,
        air_density=aircraft.air_density,
        data=_data(aircraft),
        nominal_coordinates=_row(nominal),
        nominal_rates=_row([float(f"{s:.2g}") for s in speed]),
        equations=_equations(),
    )


def _equations() -> str:
    lines = [f"  {name}{suffix} = {vector}[{i}];" for suffix, vector in _KINDS for i, name in enumerate(POINTS, 1)]
    lines += [f"  {name}_position = q[{30 + i}];" for i, name in enumerate(SURFACES, 1)]
    lines += [f"  {name}_rate = v[{30 + i}];" for i, name in enumerate(SURFACES, 1)]
    return "\n".join([*lines, ""])


_KINDS = (("", "position"), ("_rate", "velocity"), ("_acceleration", "acceleration"))


def _outputs() -> str:
    text = ""
    for suffix, _ in _KINDS:
        for name in POINTS:
            base = "rad" if name.startswith("theta") else "m"
            unit = base + {"": "", "_rate": "/s", "_acceleration": "/s2"}[suffix]
            said = f"{name.split('_')[0]} of the {' '.join(name.split('_')[1:])}"
            kind = {"": "", "_rate": ", rate", "_acceleration": ", acceleration"}[suffix]
            text += OUTPUT.format(name=name, suffix=suffix, unit=unit, text=said + kind)
    for suffix, unit in (("_position", "rad"), ("_rate", "rad/s")):
        for name in SURFACES:
            text += OUTPUT.format(name=name, suffix=suffix, unit=unit, text=f"{name.replace('_', ' ')} {suffix[1:]}")
    return text


def _data(aircraft: Aircraft) -> str:
    lines = [
        _vector(
            "modal_frequency", aircraft.hertz, "Structural frequencies of the modes, surge, heave and pitch first [Hz]"
        ),
        _vector("modal_damping", aircraft.damping, "Structural damping ratios of the modes"),
        _vector("inertia", aircraft.inertia, "Moments of inertia of the surfaces about their hinges [kg.m2]"),
        *(
            _vector(
                f"coupling_{name}",
                aircraft.coupling[:, i],
                f"Inertial coupling of the modes with the {name} [kg(1/2).m]",
            )
            for i, name in enumerate(SURFACES)
        ),
        _vector("actuator_stiffness", aircraft.actuator_stiffness, "of the surfaces' actuators [N.m/rad]"),
        _vector("actuator_damping", aircraft.actuator_damping, "of the surfaces' actuators [N.m.s/rad]"),
        _matrix("shape", aircraft.shape, "Displacements of the points by the coordinates, in the order of the outputs"),
        _matrix("aero_stiffness", aircraft.A0, "Aerodynamic stiffness per dynamic pressure"),
        _matrix("aero_damping", aircraft.A1, "Aerodynamic damping per dynamic pressure, for rate over airspeed"),
        _matrix("late_force", aircraft.L, "Forces of the late lift per dynamic pressure"),
        _matrix("late_angle", aircraft.E0, "Mean angles of attack of the strips' groups by position"),
        _matrix("late_heave", aircraft.E1, "and by rate over airspeed"),
        _vector("gust_force", aircraft.gust_force(), "Forces of a gust per dynamic pressure, for gust over airspeed"),
        _vector("late_rate", aircraft.lag, "Lag rates per airspeed [1/m]"),
    ]
    return "".join(lines)


def _vector(name: str, values: Floats, text: str) -> str:
    return f'  parameter Real {name}[{len(values)}] = {_row(values)} "{text}";\n'


def _matrix(name: str, values: Floats, text: str) -> str:
    rows = ",\n    ".join(_row(row) for row in values)
    return f'  parameter Real {name}[{values.shape[0]}, {values.shape[1]}] = {{\n    {rows}}} "{text}";\n'


def _row(values: Floats | Sequence[float]) -> str:
    return "{" + ", ".join(f"{float(v):.7g}" for v in values) + "}"
