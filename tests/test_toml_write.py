"""A system that is written as a system file is read back as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from workbench.core.machine.bundled_files import bundled_files
from workbench.core.records.record import plain
from workbench.core.values.conversion import Unit
from workbench.errors import InputError
from workbench.fmi.description import DefaultExperiment
from workbench.system.description import (
    BlockComponent,
    Component,
    Connection,
    FmuComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    MasterOptions,
    SumComponent,
    SystemDescription,
)


def facts(component: Component) -> object:
    """What a component is; matrices read from another file stand in the new one."""
    told = component.block.given if isinstance(component, BlockComponent) else None
    return [type(component), told, plain({k: v for k, v in vars(component).items() if k not in ("file", "block")})]


def every_component(folder: Path) -> SystemDescription:
    (folder / "a b.fmu").write_bytes(b"")
    linear = LinearComponent(
        name="lag",
        A=np.array([[0.5, 0.1], [0.0, 0.3]]), B=np.array([[1.0], [2.0]]), C=np.array([[1.0, 0.0]]), D=np.zeros((1, 1)),
        dt=0.1,
        x0=np.array([0.1, 1e-17]), input_names=("in",), output_names=("out",), state_names=("p", "q"),
        units={"in": "rad"},
    )  # fmt: skip
    constant = LinearComponent(
        name="order zero", A=np.zeros((0, 0)), B=np.zeros((0, 1)), C=np.zeros((1, 0)), D=np.full((1, 1), 2.0), dt=0.0,
        x0=np.zeros(0), input_names=("u",), output_names=("y",), state_names=(),
    )  # fmt: skip
    table = {"x": [0.0, 1.0], "y": [0.0, 2.0], "extrapolation": "linear"}
    return SystemDescription(
        name='a "name"',
        components=(
            FmuComponent(
                name="plant", file=str(folder / "a b.fmu"), set={"J": 2.0, "on": True}, step=0.1, dependencies="all"
            ),
            linear,
            constant,
            GainComponent(name="gain", gain=-1.0 / 3.0, units={"u": "deg"}),
            SumComponent(name="sum", signs=(1.0, -1.0), unit="rad"),
            BlockComponent(name="table", kind="lookup", parameters=table, units={"y": "m"}),
        ),
        connections=(
            Connection(source="sum.y", destination="gain.u"),
            Connection(source="gain.y", destination="lag.in", gain=2.0, offset=-1.0, convert=False, closes_at=3.0),
            Connection(source="lag.out", destination="table.u", unit="rad"),
        ),
        inputs={"one.a": ("sum.u1",), "two": ("sum.u2", "order zero.u")},
        outputs={"y": "table.y"},
        default_experiment=DefaultExperiment(0.0, 5.0, 1e-6, None),
        master=MasterOptions(order="jacobi", extrapolation=2),
    )


def everything(system: SystemDescription) -> list[object]:
    names = ("name", "connections", "inputs", "outputs", "default_experiment", "master")
    return [[facts(c) for c in system.components], *((name, getattr(system, name)) for name in names)]


def test_every_kind_of_component_is_read_back(tmp_path: Path) -> None:
    given, file = every_component(tmp_path), tmp_path / "inner" / "s.toml"
    file.parent.mkdir()
    wb.write_toml(given, file)
    assert 'model = "../a b.fmu"' in file.read_text(encoding="utf-8")
    assert everything(wb.read_system(file)) == everything(given)
    assert wb.read_system(file).components[0] == given.components[0]


@pytest.mark.parametrize("name", sorted(bundled_files("systems")))
def test_every_bundled_system_is_read_back(name: str, tmp_path: Path) -> None:
    given = wb.read_system(f"system:{name}")
    wb.write_toml(given, tmp_path / "s.toml")
    assert everything(wb.read_system(tmp_path / "s.toml")) == everything(given)


def test_what_a_system_file_cannot_hold_is_refused(tmp_path: Path) -> None:
    given = every_component(tmp_path)
    function = FunctionComponent(name="f", function=abs)
    plant = FmuComponent(name="plant", file="fmu:Rudder", units={"del": "deg"})
    for wrong, said in (
        (replace(given, components=(function,)), "component f is a Python function"),
        (replace(given, components=(plant,)), "cannot declare units of an FMU; write an .ssp"),
        (
            replace(given, units={"league": Unit("league", factor=5556.0)}),
            r"cannot define units \(league\); write an .ssp",
        ),
    ):
        with pytest.raises(InputError, match=said):
            wb.write_toml(wrong, tmp_path / "s.toml")
        assert not (tmp_path / "s.toml").exists()
    with pytest.raises(InputError, match=r"must end in .toml"):
        wb.write_toml(given, tmp_path / "s.txt")
