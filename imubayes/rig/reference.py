"""Errors of the reference equipment, as perturbations of what the rig says that it applied.

Vectors v (f, w and dw) are components along the case axes, and ``f = +g`` up at rest:

- the zero of a tumble's table off by d about the normal n of a plane, right-handed in the sense in which its
  positions turn: ``v' = v + d n x v``;
- the case turned by rho in its fixture: ``v' = v - rho x v``;
- gravity off by dg: ``f' = f + dg up``, up being along f at rest, along the axis of what turns, and along the
  mean of f in a mount that is shaken;
- radius off by dR/R: ``across' = (1 + dR/R) across``, the part of f across the axis of a centrifuge; a
  stretch k of the arm by its level: ``across' = (1 + k |across|) across``;
- a rate off by s: ``w' = (1 + s) w``, and the part of f across its axis by the powers of the rate in it;
- a latency tau: what the rig says for t was applied at ``t + tau``.

Errors are applied exactly, not linearised: rotations keep every length. Time comes first, then sizes, then
the table, then the case (see `imubayes.rig.bench`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import TermError
from imubayes.rig.inputs import Run
from imubayes.rig.motion import Motion, faster, heavier, in_fixture, longer, on_table, stretched
from imubayes.rig.plans import Plan
from imubayes.sensors import terms
from imubayes.units import factor

EARTH = "earth_rate"
"""The kind of error that the Earth is: its rate along the axis of a table is not in what the table tells."""

ANY_AXIS = 8.68
"""deg/h: sd of the Earth's rate along an axis that may point anywhere, 15.04 / sqrt(3)."""

OFFSET = "turn_on"
"""The kind of error that is none of the inputs."""

TURNING = ("centrifuge", "rate-table", "oscillation")
"""Procedures about an axis that w tells; but where |f| is the same in every row, all of f is gravity."""

EVERY = ("tumble", *TURNING, "thermal", "static", "other")
"""Procedures with known inputs."""


@dataclass(frozen=True, slots=True, eq=False)
class Kind:
    """A kind of error of the reference equipment.

    Attributes
    ----------
    name : key in a study.
    unit, printed : SI unit, and the unit that people use; those of ``turn_on`` are for an accelerometer, see
        `for_sensor`.
    key : of its size in the catalogue; empty where the catalogue has none.
    procedures : that it applies to.
    each : what it is one error of: ``bench``, ``machine`` (all runs of a procedure), ``run`` or ``mount``.
    parts : axes of the case where it is a vector, else one empty text.
    text : in words.
    step : for the derivative of the output, SI (in sampling intervals for ``latency``): so small that the
        curvature over it is below 1e-7 of the slope, so large that rounding is below 1e-9.
    apply : gives the perturbed motion for sizes (n, parts) of the error in each row; None for an error that
        is none of the motion.
    """

    name: str
    unit: str
    printed: str
    key: str
    procedures: tuple[str, ...]
    each: str
    parts: tuple[str, ...]
    text: str
    step: float
    apply: Callable[[Motion, FloatArray], Motion] | None

    @property
    def shown_by(self) -> str:
        """What of the inputs shows it, in words."""
        turns = set(self.procedures) <= set(TURNING)
        return "the rate that it turns at (w_i, w_j, w_k)" if turns else "a force or a rate (f_i, ..., w_k)"

    @property
    def default(self) -> float | None:
        """Sd in SI that the catalogue holds for typical, of the Earth any axis; None where there is none."""
        from imubayes.sensors.catalogue import reference_errors

        usual = ANY_AXIS * factor(self.printed, self.unit) if self.name == EARTH else None
        return reference_errors()[self.key][1] if self.key else usual


def for_sensor(kind: Kind, sensor: terms.Kind) -> Kind:
    """Kind of error with the units of a sensor's output where it is an error of the output.

    Examples
    --------
    >>> for_sensor(KINDS["turn_on"], "gyroscope").unit, for_sensor(KINDS["gravity"], "gyroscope").unit
    ('rad/s', 'm/s^2')
    """
    gyroscope = kind.name == OFFSET and sensor == "gyroscope"
    return replace(kind, unit="rad/s", printed="deg/h") if gyroscope else kind


_AXES, _ONE = tuple(terms.AXES), ("",)

KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("latency", "s", "ms", "", EVERY, "bench", _ONE,
             "latency of the sensor behind the rig", 1e-4, None),
        Kind("gravity", "m/s^2", "ug", "gravity", EVERY, "bench", _ONE,
             "error of local gravity", 1e-3, heavier),
        Kind("rate_scale", "1", "ppm", "rate_accuracy", TURNING, "machine", _ONE,
             "scale error of the rig's rate", 1e-4, faster),
        Kind(EARTH, "rad/s", "deg/h", "", ("free-tumble",), "bench", _ONE,
             "Earth's rate along the table's axis", 1e-7, None),
        Kind("radius", "1", "ppm", "centrifuge_radius", ("centrifuge",), "bench", _ONE,
             "error of the arm's radius", 1e-4, longer),
        Kind("arm_stretch", "1/(m/s^2)", "ppm/g", "centrifuge_arm_stretch", ("centrifuge",), "bench", _ONE,
             "stretch of the arm by its level", 1e-7, stretched),
        Kind("table_zero", "rad", "arcsec", "index_table", ("tumble",), "bench", _ONE,
             "common zero of the tumble's table", 1e-4, on_table),
        Kind("plane_zero", "rad", "arcsec", "index_table", ("tumble",), "mount", _ONE,
             "zero of the tumble's table", 1e-4, on_table),
        Kind("fixture_common", "rad", "arcsec", "fixture_mount", EVERY, "bench", _AXES,
             "rotation of the case in its fixture", 1e-4, in_fixture),
        Kind("fixture", "rad", "arcsec", "fixture_mount", EVERY, "mount", _AXES,
             "rotation of the case in its fixture", 1e-4, in_fixture),
        Kind(OFFSET, "m/s^2", "ug", "", EVERY, "run", _ONE,
             "offset of the bias since the sensor was turned on", 1.0, None),
    )
}  # fmt: skip
"""Kinds of errors by their key in a study, in the order in which they are applied."""

TILT = Kind("tilt", "rad", "urad", "", EVERY, "bench", ("j", "k"),
            "tilt of the axes that the coefficients refer to", 1e-4, None)  # fmt: skip
"""What comes with a rotation in the fixture. Powers and products of inputs belong to the sensor's own axes,
which the misalignment tilts; the model lets them act along the case's. Without this allowance a strong cubic
would tell a rotation of the case from a misalignment, by nothing but that convention."""

LACK = "lack"
"""What names of functions begin with that stand for what the library lacks: no error of a bench, and a column
beside the terms as these are."""

_EVERY_KIND = {**KINDS, TILT.name: TILT}


@dataclass(frozen=True, slots=True)
class Error:
    """One unknown number of the test bench: ``gravity``, ``turn_on.log``, ``fixture_j.tumble.2``.

    It is number `part` of the parts of a kind (key of `KINDS`), in words `text`, and may be confined to a
    procedure, a run or a mount: these are empty or None where it is not.
    """

    name: str
    kind: str
    part: int
    text: str
    procedure: str = ""
    run: str = ""
    mount: int | None = None

    def applies(self, run: Run | Plan) -> bool:
        """Tell whether the error moves anything in a run."""
        here = run.procedure in _EVERY_KIND[self.kind].procedures
        return here and self.procedure in ("", run.procedure) and self.run in ("", run.name)


HEADS: Mapping[str, str] = {
    f"{kind.name}_{part}" if part else kind.name: kind.name
    for kind in _EVERY_KIND.values()
    for part in kind.parts
}
"""What the names of errors begin with, before the first dot, and the kinds that they are of."""


def errors_of(runs: Sequence[Run | Plan], kinds: Iterable[str]) -> tuple[Error, ...]:
    """Unknown numbers of the given kinds over the runs; a `TermError` if a kind is not known.

    Examples
    --------
    >>> from imubayes.rig.tumbles import tumble
    >>> [error.name for error in errors_of([tumble(planes=2)], ["gravity", "plane_zero"])]
    ['gravity', 'plane_zero.tumble.0', 'plane_zero.tumble.1']
    """
    return tuple(
        Error(
            ".".join((f"{kind.name}_{axis}" if axis else kind.name, *place)),
            kind.name,
            part,
            " ".join(filter(None, (kind.text, f"about {axis}" if axis else "", where))),
            **confined,
        )
        for kind in map(kind_of, kinds)
        for place, where, confined in _places(
            [run for run in runs if run.procedure in kind.procedures], kind.each
        )
        for part, axis in enumerate(kind.parts)
    )


def kind_of(name: str) -> Kind:
    """Kind of error by its name; a `TermError` if it is not known."""
    if name not in _EVERY_KIND:
        raise TermError(f"'{name}' is no error of a test bench: known are {', '.join(KINDS)}")
    return _EVERY_KIND[name]


def _places(runs: Sequence[Run | Plan], each: str) -> list[tuple[tuple[str, ...], str, dict]]:
    """Return what the errors of a kind are confined to: the name's tail, in words, and as fields."""
    if each == "machine":
        procedures = dict.fromkeys(run.procedure for run in runs)
        return [((p,), f"in {p} runs", {"procedure": p}) for p in procedures]
    if each == "run":
        return [((run.name,), f"in run {run.name}", {"run": run.name}) for run in runs]
    if each == "mount":
        return [
            ((run.name, str(m)), f"in mount {m} of run {run.name}", {"run": run.name, "mount": m})
            for run in runs
            for m in np.unique(run.inputs.mounts).tolist()
        ]
    return [((), "", {})]
