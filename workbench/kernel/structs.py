"""The kernel's structures (its header files) as ctypes; the library says at load whether the sizes agree."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from ctypes import c_bool, c_char, c_double, c_int32, c_int64, c_size_t, c_void_p
from typing import Any

from workbench.fmi.instants import Instants
from workbench.fmi.intermediate import Intermediate
from workbench.fmi.ticking import Clocks, Tick
from workbench.kernel.gear import GearLibrary

__all__ = [
    "FUNCTIONS",
    "STRUCTURES",
    "Access",
    "BlockStruct",
    "CType",
    "Component",
    "Control",
    "Cs",
    "Element",
    "Failure",
    "ForcingStruct",
    "Fourier",
    "Groups",
    "Link",
    "Lti",
    "Master",
    "Me",
    "Predictor",
    "RecordStruct",
    "SignalStruct",
    "Slopes",
    "Sparsity",
    "System",
    "UnitStruct",
    "Wires",
    "name_in_c",
]

MESSAGE = 256
PARAMETERS = 5

# What the kernel calls by address, in the order of FunctionIndex in component.h.
FUNCTIONS = (
    "set_time",
    "set_states",
    "get_states",
    "get_derivatives",
    "get_indicators",
    "completed_step",
    "enter_event_mode",
    "enter_continuous_mode",
    "enter_step_mode",
    "update_discrete_states",
    "do_step",
    "set_slopes",
    "get_directional",
    "get_fmu_state",
    "set_fmu_state",
    "free_fmu_state",
    "set_clock",
    "get_interval",
    "get_clock",
)


class CType:
    """ValueType in access.h."""

    NUMBERS: Mapping[Any, int] = {
        ctypes.c_double: 0,
        ctypes.c_float: 1,
        ctypes.c_int8: 2,
        ctypes.c_uint8: 3,
        ctypes.c_int16: 4,
        ctypes.c_uint16: 5,
        ctypes.c_int32: 6,
        ctypes.c_uint32: 7,
        ctypes.c_int64: 8,
        ctypes.c_uint64: 9,
    }
    FLOAT64 = 0
    BOOLEAN8, BOOLEAN32, TICKS = 10, 11, 12


class Failure(ctypes.Structure):
    """failure.h."""

    code: int
    status: int
    component: int
    function: int
    index: int
    time: float
    value: float
    name: bytes | None
    message: bytes

    _fields_ = (
        ("code", c_int32),
        ("status", c_int32),
        ("component", c_int32),
        ("function", c_int32),
        ("index", c_int64),
        ("time", c_double),
        ("value", c_double),
        ("name", ctypes.c_char_p),
        ("message", c_char * MESSAGE),
    )


class Component(ctypes.Structure):
    """component.h."""

    _fields_ = (
        ("handle", c_void_p),
        ("functions", c_void_p),
        ("names", c_void_p),
        ("nx", c_size_t),
        ("nz", c_size_t),
        ("version", c_int32),
        ("event_mode", c_int32),
        ("completed_step", c_int32),
        ("interpolates", c_int32),
        ("slopes_work", c_int32),
        ("centres", c_int32),
        ("event_due", c_int32),
        ("time", c_double),
        ("due", c_double),
        ("clock", c_double),
        ("calls", c_void_p),
        ("clocks", c_void_p),
        ("intermediate", c_void_p),
        ("ticked", c_int32),
        ("in_circle", c_int32),
        ("before", c_void_p),
        ("saved", c_void_p),
        ("longest", c_void_p),
    )


class BlockStruct(ctypes.Structure):
    """access.h: variables of one type and component."""

    _fields_ = (
        ("get", c_void_p),
        ("set", c_void_p),
        ("get_name", ctypes.c_char_p),
        ("set_name", ctypes.c_char_p),
        ("references", c_void_p),
        ("n_references", c_size_t),
        ("buffer", c_void_p),
        ("n_values", c_size_t),
        ("slots", c_void_p),
        ("columns", c_void_p),
        ("n", c_size_t),
        ("type", c_int32),
        ("component", c_int32),
        ("partial", c_int32),
        ("plain", c_int32),
    )


class Access(ctypes.Structure):
    """access.h."""

    _fields_ = (("blocks", c_void_p), ("n_blocks", c_size_t))


class SignalStruct(ctypes.Structure):
    """signals.h."""

    _fields_ = (
        ("kind", c_int32),
        ("p", c_double * PARAMETERS),
        ("times", c_void_p),
        ("values", c_void_p),
        ("bits", c_void_p),
        ("n", c_size_t),
        ("evaluate", c_void_p),
        ("following", c_void_p),
    )


class ForcingStruct(ctypes.Structure):
    """forcing.h."""

    _fields_ = (
        ("signals", c_void_p),
        ("bias", c_void_p),
        ("types", c_void_p),
        ("owners", c_void_p),
        ("discrete", c_void_p),
        ("written", c_void_p),
        ("wanted", c_void_p),
        ("seen", c_void_p),
        ("slopes", c_void_p),
        ("orders", c_void_p),
        ("n", c_size_t),
        ("n_discrete", c_size_t),
        ("fast", Access),
        ("slow", Access),
        ("longest_step", c_double),
        ("break_from", c_double),
        ("break_at", c_double),
        ("wanted_at", c_double),
        ("has_break", c_int32),
        ("has_wanted", c_int32),
    )


class Link(ctypes.Structure):
    """system.h."""

    _fields_ = (
        ("source", Access),
        ("destination", Access),
        ("members", c_void_p),
        ("n", c_size_t),
        ("work", c_void_p),
        ("jacobian", c_void_p),
        ("known", c_void_p),
        ("from", c_void_p),
        ("to", c_void_p),
        ("unknowns", c_void_p),
        ("knowns", c_void_p),
        ("asked", c_void_p),
        ("exact", c_void_p),
    )


class Wires(ctypes.Structure):
    """system.h."""

    _fields_ = (
        ("gains", c_void_p),
        ("offsets", c_void_p),
        ("closes_at", c_void_p),
        ("typical", c_void_p),
        ("values", c_void_p),
        ("sizes", c_void_p),
        ("fresh", c_void_p),
        ("seen", c_void_p),
        ("to", c_void_p),
        ("closed", c_void_p),
        ("n", c_size_t),
    )


class Lti(ctypes.Structure):
    """lti.h: one block; the caller owns what it points to."""

    time: float
    instants: Instants
    ticks: int
    ticking: int
    function: Any

    _fields_ = (
        ("nx", c_size_t),
        ("nu", c_size_t),
        ("ny", c_size_t),
        ("a", c_void_p),
        ("b", c_void_p),
        ("c", c_void_p),
        ("d", c_void_p),
        ("memory", c_void_p),
        ("next", c_void_p),
        ("function", c_void_p),
        ("instants", Instants),
        ("time", c_double),
        ("ticks", c_int64),
        ("ticking", c_int32),
    )


class Element(ctypes.Structure):
    """blocks.h: one nonlinear block or delay; the caller owns what it points to."""

    mode: Any
    longest: float

    _fields_ = (
        ("p", c_void_p),
        ("grids", c_void_p * 3),
        ("sizes", c_size_t * 3),
        ("memory", c_void_p),
        ("nu", c_size_t),
        ("nx", c_size_t),
        ("nz", c_size_t),
        ("mode", c_double * 2),
        ("time", c_double),
        ("longest", c_double),
        ("history", c_void_p),
        ("kind", c_int32),
        ("event_mode", c_int32),
    )


class System(ctypes.Structure):
    """system.h."""

    _fields_ = (
        ("components", c_void_p),
        ("n_components", c_size_t),
        ("links", c_void_p),
        ("n_links", c_size_t),
        ("moving", c_void_p),
        ("n_moving", c_size_t),
        ("wires", Wires),
        ("order", c_void_p),
        ("nx", c_size_t),
        ("nz", c_size_t),
        ("forcing", c_void_p),
        ("evaluations", c_int64),
        ("steps", c_int64),
        ("pause_at", c_int64),
        ("ordered", c_int64),
        ("limit", c_double),
        ("failure", Failure),
        ("unsolved", Failure),
    )


class Fourier(ctypes.Structure):
    """fourier.h."""

    _fields_ = (
        ("begin", c_double),
        ("frequency", c_double),
        ("orders", c_size_t),
        ("n", c_size_t),
        ("columns", c_void_p),
        ("known", c_void_p),
        ("known_times", c_void_p),
        ("n_known", c_size_t),
        ("grid", c_int32),
        ("basis", c_void_p),
        ("between", c_void_p),
        ("weights", c_void_p),
        ("sums", c_void_p),
        ("first", c_void_p),
        ("node", c_void_p),
        ("last", c_void_p),
        ("largest", c_void_p),
        ("jumped", c_void_p),
        ("nodes", c_void_p),
        ("rough", c_void_p),
        ("n_nodes", c_size_t),
        ("start", c_double),
        ("reached", c_double),
        ("time", c_double),
        ("gap", c_double),
        ("longest", c_double),
        ("rows", c_size_t),
        ("next", c_size_t),
        ("at", c_void_p),
    )


class RecordStruct(ctypes.Structure):
    """record.h."""

    _fields_ = (
        ("access", Access),
        ("n_values", c_size_t),
        ("bound", c_double),
        ("fourier", c_void_p),
        ("missing", c_int32),
        ("keep", c_int32),
        ("no_feedthrough", c_int32),
        ("checked", c_int32),
        ("read", c_int32),
        ("every", c_size_t),
        ("data", c_void_p),
        ("rows", c_size_t),
        ("capacity", c_size_t),
        ("width", c_size_t),
        ("skipped", c_size_t),
    )


class Problem(ctypes.Structure):
    """solver.h."""

    _fields_ = (
        ("owner", c_void_p),
        ("n", c_size_t),
        ("nz", c_size_t),
        ("derivatives", c_void_p),
        ("indicators", c_void_p),
        ("sparsity", c_void_p),
    )


class Turned(ctypes.Structure):
    """turned.h."""

    _fields_ = (
        ("problem", c_void_p),
        ("since", c_double),
        ("ahead", c_double),
        ("watches", c_bool),
        ("known", c_bool),
        ("side", c_void_p),
        ("bound", c_void_p),
        ("way", c_void_p),
        ("old", c_void_p),
        ("z", c_void_p),
        ("new_way", c_void_p),
        ("dx", c_void_p),
        ("old_dx", c_void_p),
        ("x", c_void_p),
    )


class Flights(ctypes.Structure):
    """event_rules.h of the runtime of built FMUs."""

    _fields_ = (
        ("last", c_double),
        ("gaps", c_double * 7),
        ("longest_pair", c_double),
        ("gathering", c_double),
        ("event", c_double),
        ("close", c_double),
    )


class Groups(ctypes.Structure):
    """solver.h."""

    _fields_ = (
        ("members", c_void_p),
        ("ends", c_void_p),
        ("n_groups", c_size_t),
        ("first", c_void_p),
        ("rows", c_void_p),
    )


class Sparsity(ctypes.Structure):
    """solver.h."""

    _fields_ = (
        ("groups", Groups),
        ("place", c_void_p),
        ("below", c_size_t),
        ("above", c_size_t),
    )


class Me(ctypes.Structure):
    """me.h."""

    _fields_ = (
        ("system", c_void_p),
        ("solver_name", ctypes.c_char_p),
        ("gear", c_void_p),
        ("sparsity", c_void_p),
        ("rtol", c_double),
        ("scale", c_void_p),
        ("most", c_void_p),
        ("time", c_double),
        ("next_time", c_double),
        ("cautious", c_double),
        ("span", c_double),
        ("flights", Flights),
        ("resumed", c_int32),
        ("steps", c_int32),
        ("told", c_int32),
        ("events", c_int64),
        ("slopes", c_void_p),
        ("solver", c_void_p),
        ("x", c_void_p),
        ("flight", c_void_p),
        ("lowest", c_void_p),
        ("highest", c_void_p),
        ("until", c_double),
        ("targets", c_void_p),
        ("n_targets", c_size_t),
        ("record", c_void_p),
        ("problem", Problem),
        ("turned", Turned),
    )


class Slopes(ctypes.Structure):
    """slopes.h."""

    _fields_ = (
        ("times", c_void_p),
        ("n_times", c_size_t),
        ("x", c_void_p),
        ("dx", c_void_p),
        ("a", c_void_p),
        ("c", c_void_p),
        ("work", c_void_p),
        ("groups", Groups),
        ("knowns", c_void_p),
        ("unknowns", c_void_p),
        ("way", c_int32),
        ("found", c_size_t),
        ("passed", c_size_t),
        ("refuted", c_size_t * 3),
    )


class Cs(ctypes.Structure):
    """cs.h."""

    _fields_ = (
        ("system", c_void_p),
        ("master", c_void_p),
        ("time", c_double),
        ("previous", c_double),
        ("fixed", c_double),
        ("longest", c_double),
        ("variable_step", c_int32),
        ("step_given", c_int32),
        ("until", c_double),
        ("start", c_double),
        ("target", c_double),
        ("count", c_double),
        ("made", c_double),
        ("targets", c_void_p),
        ("n_targets", c_size_t),
        ("record", c_void_p),
    )


class UnitStruct(ctypes.Structure):
    """master.h."""

    _fields_ = (
        ("component", c_int32),
        ("held", c_int32),
        ("as_start", c_int32),
        ("stale", c_int32),
        ("sources", c_void_p),
        ("types", c_void_p),
        ("moving", c_void_p),
        ("starts", c_void_p),
        ("ends", c_void_p),
        ("bows", c_void_p),
        ("values", c_void_p),
        ("rates", c_void_p),
        ("orders", c_void_p),
        ("n", c_size_t),
        ("inlet", Access),
        ("fast", Access),
        ("outgoing", c_void_p),
        ("raw", c_void_p),
        ("n_outgoing", c_size_t),
        ("outlet", Access),
        ("instants", c_void_p),
        ("n_instants", c_size_t),
        ("members", c_void_p),
        ("n_members", c_size_t),
        ("me", c_void_p),
        ("signals", c_void_p),
        ("times", c_void_p),
        ("tables", c_void_p),
    )


class Master(ctypes.Structure):
    """master.h."""

    _fields_ = (
        ("units", c_void_p),
        ("n_units", c_size_t),
        ("order", c_void_p),
        ("stages", c_void_p),
        ("n_stages", c_size_t),
        ("from_held", c_void_p),
        ("late", c_void_p),
        ("moves", c_void_p),
        ("known", c_void_p),
        ("start", c_void_p),
        ("reached", c_void_p),
        ("slopes", c_void_p),
        ("spans", c_void_p),
        ("ramps", c_void_p),
        ("bows", c_void_p),
        ("ramped", c_void_p),
        ("since", c_double),
        ("nobody", c_void_p),
        ("control", c_void_p),
        ("hold_inputs", c_int32),
        ("extrapolation", c_int32),
        ("event_due", c_int32),
    )


class Control(ctypes.Structure):
    """control.h."""

    _fields_ = (
        ("tolerance", c_double),
        ("step", c_double),
        ("least", c_double),
        ("longest", c_double),
        ("wires", c_void_p),
        ("n_wires", c_size_t),
        ("outputs", Access),
        ("n_outputs", c_size_t),
        ("scale", c_void_p),
        ("coarse", c_void_p),
        ("fine", c_void_p),
        ("saved", c_void_p),
        ("states", c_void_p),
        ("trial", RecordStruct),
    )


class Predictor(ctypes.Structure):
    """predictor.h."""

    _fields_ = (
        ("n", c_size_t),
        ("m", c_size_t),
        ("p", c_size_t),
        ("a", c_void_p),
        ("b", c_void_p),
        ("c", c_void_p),
        ("d", c_void_p),
        ("k", c_void_p),
        ("offset", c_void_p),
    )


STRUCTURES: tuple[type[ctypes.Structure], ...] = (
    Failure, Component, BlockStruct, Access, SignalStruct, ForcingStruct, Link, System, Fourier, RecordStruct,
    GearLibrary, Me, Cs, Wires, Lti, Slopes, UnitStruct, Master, Control, Sparsity, Clocks, Tick, Intermediate,
    Predictor, Element, Instants,
)  # fmt: skip


def name_in_c(structure: type[ctypes.Structure]) -> str:
    """Return what a structure is called in the kernel; where a class of the package has that name, it ends differently.

    Args:
        structure: one of `STRUCTURES`.
    """
    return structure.__name__.removesuffix("Struct")
