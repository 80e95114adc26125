"""From public recordings of whole IMUs to compensated output, by the exported C."""

import json
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from compiling import built, call
from scipy.spatial.transform import Rotation

from imubayes.reporting.export.characterized import characterized, identifier
from imubayes.study.schema import read_runs

ROOT = Path(__file__).parents[3]
STUDIES = ("imu_tk_xsens", "imucal_ferraris")
T0 = 298.15
"""K; neither model depends on temperature."""

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")


class Recording:
    """A run, its compensation in C, and what the committed result says of it."""

    def __init__(self, study: str, folder: Path) -> None:
        (self.run,) = read_runs(ROOT / "studies" / f"{study}.toml")
        path = ROOT / "reports" / study / "result.json"
        found = characterized(path, accept_misfit=True)
        self.function = getattr(built(found, folder), f"{identifier(found)}_compensate")
        (case,) = json.loads(path.read_text())["cases"]
        self.told = {one["what"]: one for one in case["recovered"]}
        self.stills = json.loads(path.read_text())["sensors"][0]["runs"][0]["stills"]

    def compensated(self, rows: np.ndarray) -> np.ndarray:
        """Inputs (n, 6) of outputs (n, 6)."""
        known = np.tile([0.0, 0.0, 0.0, T0, 0.0], (len(rows), 1))
        return call(self.function, rows, known, np.float64)[0]

    def means(self) -> np.ndarray:
        """Mean outputs (k, 6) of the stills."""
        both = np.hstack([self.run.force, self.run.rate])
        return np.array([both[(self.run.t >= a) & (self.run.t <= b)].mean(axis=0) for a, b in self.stills])


@pytest.fixture(scope="module")
def recording(tmp_path_factory, recordings):
    @cache
    def of(study: str) -> Recording:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("IMUBAYES_DATA", str(recordings))
            return Recording(study, tmp_path_factory.mktemp(study))

    return of


def rms(errors) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.mark.parametrize("study", STUDIES)
def test_stills_and_their_rates_are_as_the_report_says(recording, study):
    """What is flown, from raw file to C, has the residuals that the report of the fit prints."""
    one = recording(study)
    raw = one.means()
    x = one.compensated(raw)
    length = np.linalg.norm(x[:, :3], axis=1) - one.run.gravity
    assert rms(np.linalg.norm(raw[:, :3], axis=1) - one.run.gravity) == pytest.approx(
        one.told["gravity"]["rms"]["before"], rel=1e-6
    )
    assert rms(length) == pytest.approx(one.told["gravity"]["rms"]["flown"], rel=1e-4)
    assert rms(raw[:, 3:]) == pytest.approx(one.told["rest"]["rms"]["before"], rel=1e-6)
    assert rms(x[:, 3:]) == pytest.approx(one.told["rest"]["rms"]["flown"], rel=1e-4)


def carried(t: np.ndarray, w: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Up after a turn, by the rotations of its samples one after the other."""
    steps = Rotation.from_rotvec(-0.5 * np.diff(t)[:, None] * (w[:-1] + w[1:])).as_matrix()
    for step in steps:
        up = step @ up
    return up


def test_turns_of_the_xsens_close_by_integrated_compensated_rates(recording):
    one = recording("imu_tk_xsens")
    run = one.run
    missed = []
    for raw in (True, False):
        values = np.hstack([run.force, run.rate])
        values = values if raw else one.compensated(values)
        means = [values[(run.t >= a) & (run.t <= b), :3].mean(axis=0) for a, b in one.stills]
        up = [m / np.linalg.norm(m) for m in means]
        angles = []  # sines, as the report's
        for k, ((_, a), (b, _)) in enumerate(zip(one.stills, one.stills[1:], strict=False)):
            inside = (run.t >= a) & (run.t <= b)
            end = carried(run.t[inside], values[inside, 3:], up[k])
            angles.append(np.linalg.norm(np.cross(end, up[k + 1])))
        missed.append(rms(angles))
    told = one.told["closure"]["rms"]
    # steps without coning: some 1e-4 of a turn
    assert missed == pytest.approx([told["before"], told["flown"]], rel=0.02)
    assert missed[1] < 1.5 * told["fresh"] < 0.1 * missed[0]


def test_turns_of_the_ferraris_session_are_whole_turns(recording):
    one = recording("imucal_ferraris")
    run = one.run
    for raw in (True, False):
        errors = []
        for section in (s for s in run.sections if s.angle):
            inside = slice(section.start, section.stop)
            values = np.hstack([run.force[inside], run.rate[inside]])
            w = (values if raw else one.compensated(values))[:, 3:] @ section.direction
            errors.append(run.interval * w.sum() - section.angle)
        told = one.told["turn"]["rms"]["before" if raw else "flown"]
        assert rms(errors) == pytest.approx(told, rel=1e-3, abs=1e-6)
    assert rms(np.rad2deg(errors)) < 0.2
