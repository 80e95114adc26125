"""Make ``pyins.json``: what single sensor errors come to in pyins, which shares no code with this project.

pyins (github nmayorov/pyins, MIT) is not on PyPI: clone it, and run with it, pandas and numba on the path

    PYTHONPATH=PYINS python tests/scenes/make_pyins.py

Each flight of `flights.path` starts at 45 degrees north; its readings are `pyins.sim.generate_imu`'s, and
are integrated by `pyins.strapdown.Integrator` with height held, with and without the error of one term of one
sensor. The differences are attitude (rotation vector between the two, each in the local level of its own
place, but for the convergence of the meridians), horizontal velocity and position; beside them those of
`pyins.error_model.propagate_errors`.
"""

import json
import sys
from pathlib import Path

import flights
import numpy as np

SOURCE = "github nmayorov/pyins, commit 8377edecff8ebbeaf6c39ec2035d51451de2310d"
TURNED = np.array([1.0, -1.0, -1.0])
"""From forward, left, up and north, west, up to forward, right, down and north, east, down."""

STEP, SECONDS, AT = 0.1, 300.0, (100.0, 300.0)
TERMS = {
    "b0": lambda i, j, k: np.ones_like(i),
    "b1": lambda i, j, k: i,
    "b2": lambda i, j, k: i**2,
    "b1p": lambda i, j, k: np.abs(i),
    "m_j": lambda i, j, k: j,
    "m_k": lambda i, j, k: k,
    "c_jk": lambda i, j, k: j * k,
}
"""Column of each term, of what the sensor feels along its axes."""

LARGEST = {"accelerometer": 1e-3, "gyroscope": 1e-6}
"""m/s^2 and rad/s: the largest error of a term over the flight, so that its square does not count."""

FAINT = {"accelerometer": 0.05, "gyroscope": 1e-3}
"""Columns that never exceed this have what the Earth's form leaves of a balanced turn, and are left out."""


def main() -> None:
    """Write the file beside this one."""
    import pyins
    from pyins import error_model, sim, strapdown, transform

    def flown(imu):
        increments = strapdown.compute_increments_from_imu(imu, "rate")
        integrator = strapdown.Integrator(trajectory.iloc[0], with_altitude=False)
        return integrator.integrate(increments).iloc[rows]

    def apart(one, other):
        turns = transform.mat_from_rph(one[RPH]) @ np.swapaxes(transform.mat_from_rph(other[RPH]), 1, 2)
        turn = (0.5 * (turns - np.swapaxes(turns, 1, 2)))[:, [2, 0, 1], [1, 2, 0]]
        # north itself is another where the meridians of the two places meet
        turn[:, 2] -= np.radians(one.lon - other.lon) * np.sin(np.radians(other.lat))
        attitude = np.linalg.norm(turn, axis=1)
        velocity = np.linalg.norm((one[VEL] - other[VEL]).to_numpy()[:, :2], axis=1)
        place = transform.compute_lla_difference(one[LLA], other[LLA])
        return attitude, velocity, np.linalg.norm(np.asarray(place)[:, :2], axis=1)

    LLA, VEL, RPH = pyins.util.LLA_COLS, pyins.util.VEL_COLS, pyins.util.RPH_COLS
    t = STEP * np.arange(round(SECONDS / STEP) + 1)
    rows, found = [round(at / STEP) for at in AT], []
    for path in ("straight", "circle", "turns", "spin", "boost"):
        angles, velocity = flights.path(path, t)
        rph = np.degrees(angles[:, ::-1] * TURNED)
        trajectory, imu = sim.generate_imu(t, [45.0, 0.0, 0.0], rph, velocity * TURNED)
        gyro, accel = (imu[list(columns)].to_numpy() for columns in (GYRO, ACCEL))
        none = flown(imu)
        for kind, felt in (("accelerometer", accel * TURNED), ("gyroscope", gyro * TURNED)):
            for axis, order in (("x", (0, 1, 2)), ("y", (1, 2, 0)), ("z", (2, 0, 1))):
                for term, column in TERMS.items():
                    error = column(*felt[:, order].T)
                    if np.abs(error).max() < FAINT[kind]:
                        continue
                    size = LARGEST[kind] / np.abs(error).max()
                    error = size * error[:, None] * np.eye(3)[order[0]] * TURNED
                    wrong = imu.copy()
                    wrong[list(ACCEL if kind == "accelerometer" else GYRO)] += error
                    linear, _ = error_model.propagate_errors(
                        trajectory,
                        **{"accel_error" if kind == "accelerometer" else "gyro_error": error},
                        with_altitude=False,
                    )
                    linear = linear.iloc[rows]
                    modelled = np.hypot(linear.VN, linear.VE), np.hypot(linear.north, linear.east)
                    sizes = (*apart(flown(wrong), none), *modelled)
                    rounded = [[float(f"{v:.5g}") for v in one] for one in sizes]
                    found.append([path, kind, axis, term, size, *rounded])
    head = {"source": SOURCE, "made": "tests/scenes/make_pyins.py", "at": AT, "columns": COLUMNS}
    lines = ",\n".join(map(json.dumps, found))
    text = f'{json.dumps(head)[:-1]}, "errors": [\n{lines}\n]}}\n'
    Path(__file__).with_name("pyins.json").write_text(text, encoding="utf-8")


COLUMNS = (
    "path", "kind", "axis", "term", "size",
    "attitude", "velocity", "position", "velocity by the error model", "position by the error model",
)  # fmt: skip
GYRO, ACCEL = ("gyro_x", "gyro_y", "gyro_z"), ("accel_x", "accel_y", "accel_z")

if __name__ == "__main__":
    sys.exit(main())
