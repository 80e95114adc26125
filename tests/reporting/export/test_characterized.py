"""Reading a result as an IMU: which entries, which terms, which range."""

import json
from pathlib import Path

import numpy as np
import pytest
from exported_results import ENDS, coefficients, edited, entry, library_for, no_noise, write_draws, write_imu

from imubayes.errors import DataError, InputError
from imubayes.reporting.export import exported
from imubayes.reporting.export.characterized import characterized, heading
from imubayes.sensors.imu import COMPONENTS, forward, signals
from imubayes.sensors.imu_compensation import compensate

REPORTS = Path(__file__).parents[3] / "reports"


def test_six_entries_that_start_alike_are_one_imu_with_their_means(tmp_path):
    found = characterized(write_imu(tmp_path))
    assert tuple(found.parts) == COMPONENTS
    for name, component in zip(COMPONENTS, found.imu.components, strict=True):
        truth = coefficients()[name]
        assert set(component.library.names) == {term for term in truth if not term.endswith("p")}
        np.testing.assert_array_equal(component.theta, [truth[term] for term in component.library.names])


def test_the_full_model_has_every_term_that_was_tested_at_its_full_mean(tmp_path):
    def untest(document):
        document["sensors"][0] = entry("U-1.ax", "ax", coefficients()["ax"], dropped=["s_i"])

    found = characterized(edited(write_imu(tmp_path), untest), model="full")
    names = found.imu.components[0].library.names
    assert set(names) == set(library_for("ax").names) - {"s_i"}
    np.testing.assert_allclose(
        found.imu.components[0].theta, [1.001 * coefficients()["ax"][n] for n in names]
    )


def test_a_scene_has_its_own_terms_and_says_what_it_leaves_out(tmp_path):
    found = characterized(write_imu(tmp_path), model="uav_hover")
    assert {component.library.names for component in found.imu.components} == {("b0", "b1")}
    assert "rms of what is left out, SI: ax 0.25" in heading(found)[0]


@pytest.mark.parametrize("model", ["needed", "full", "basic"])
@pytest.mark.parametrize("at", ["start", "end"])
def test_the_bias_at_an_end_is_as_far_from_the_mean_in_every_model(model, at):
    """A smaller model's b0 has taken up other terms, and keeps that part."""
    path = REPORTS / "quickstart"
    (sensor,) = json.loads((path / "result.json").read_text())["sensors"]
    walked, (mean, moved) = (
        sensor["bias"],
        (characterized(path, model=model, bias_at=where).parts["ax"] for where in ("mean", at)),
    )
    b0 = mean.component.library.names.index("b0")
    change = moved.component.theta - mean.component.theta
    assert change[b0] == pytest.approx(walked[at]["mean"] - walked["mean"]["mean"], rel=1e-6)
    assert not np.delete(change, b0).any()
    more = walked[at]["sd"] ** 2 - walked["mean"]["sd"] ** 2
    assert moved.covariance[b0, b0] == pytest.approx(mean.covariance[b0, b0] + more, rel=1e-9)


def test_the_range_is_the_largest_input_along_the_case_axes_over_all_runs(tmp_path):
    def widen(document):  # j of the y component is z of the case
        document["sensors"][1]["runs"][0]["ranges"]["f_j"] = [-80.0, 70.0]

    found = characterized(edited(write_imu(tmp_path), widen))
    assert found.within.f == (ENDS["f"], ENDS["f"], 80.0)
    assert (found.within.T, found.within.warming) == (ENDS["T"], ENDS["dT"])


def test_a_test_in_the_hand_is_valid_for_an_imu_that_lies_flat(tmp_path):
    """No position has an axis quite upright: the range was up to 8.75 m/s^2 along z."""

    def held(document):
        for one in document["sensors"]:
            for run in one["runs"]:
                run["procedure"] = "free-tumble"
                run["ranges"] |= {f"f_{axis}": [-8.75, 8.0] for axis in "ijk"}

    found = characterized(edited(write_imu(tmp_path), held), model="uav-hover")
    flat = signals([[0.0, 0.0, 9.81]])
    assert min(found.within.f) == pytest.approx(1.1 * 9.80665)
    np.testing.assert_allclose(compensate(found.imu, forward(found.imu, flat), found.within).f, flat.f)


def test_noise_is_of_the_static_runs_where_there_are_any(tmp_path):
    found = characterized(write_imu(tmp_path)).parts["ax"]
    raw = json.loads((tmp_path / "result.json").read_text())["sensors"][0]["noise"]
    assert (found.noise.N, found.noise_runs) == (raw["night"]["N"], ("night",))


def test_the_covariance_is_that_of_the_draws_beside_the_result(tmp_path):
    path = write_imu(tmp_path)
    names, rng = [*library_for("ax").names], np.random.default_rng(3)
    mixing = rng.normal(size=(len(names), len(names)))
    draws = rng.normal(size=(400, len(names))) @ mixing
    write_draws(path, "U-1.ax", names, draws)
    found = characterized(path)
    kept = [names.index(term) for term in found.parts["ax"].component.library.names]
    centred = draws[:, kept] - draws[:, kept].mean(axis=0)
    np.testing.assert_allclose(found.parts["ax"].covariance, centred.T @ centred / 399, rtol=1e-10)
    assert found.parts["ax"].joint and not found.parts["ay"].joint


@pytest.mark.parametrize("study", ["quickstart", "xsens_tumble"])
def test_committed_results_are_imus(study):
    found = characterized(REPORTS / study, accept_misfit=True)
    terms = {t for c in found.imu.components for t in c.library.names}
    assert {"b0", "b1", "m_j"} <= terms and "s_k" not in terms  # never excited
    assert found.source.sha256 in "".join(heading(found))


def _bent(document):
    next(term for term in document["sensors"][0]["terms"] if term["name"] == "b2")["mean"] = 0.01


def _rejected(document):
    document["sensors"][1]["terms"][0]["conditional"] = True


def _silent(document):
    document["sensors"][4]["noise"] = {}


def _halved(document):
    del document["sensors"][3:]


def _doubled(document):
    document["sensors"].append(entry("V-2", "gx", coefficients()["gx"]))


@pytest.mark.parametrize(
    ("to", "options", "edit", "said"),
    [
        ("json", {"model": "uav-hower"}, None, "uav-hover"),
        ("json", {"sensor": "U-2"}, None, "'U-2' is not in it.*U-1"),
        ("json", {}, _doubled, "2 sensors: name one of U-1, V-2"),
        ("json", {}, _rejected, r"reject the model of U-1.ay: .*--accept-misfit"),
        ("ros", {}, None, "'ros' is not known: expected one of kalibr"),
        ("c", {}, _bent, "cannot be shown to be invertible"),
        ("px4", {}, None, r"PX4 has no parameter for ax.*choose --model basic"),
        ("kalibr", {}, _halved, "U-1 has no gyroscope"),
        ("kalibr", {}, no_noise("B", "K"), "takes no random walk of zero"),
        ("kalibr", {}, no_noise("N"), r"nothing of the noise of U-1\.ax.*: expected N"),
        ("filter", {}, _silent, r"nothing of the noise of U-1\.gy: expected N"),
    ],
)
def test_what_cannot_be_exported_is_refused_with_what_there_is(tmp_path, to, options, edit, said):
    path = edited(write_imu(tmp_path), edit or str)
    with pytest.raises(InputError, match=said):
        exported(path, to, **options)


def test_what_is_refused_is_exported_where_it_is_named_or_accepted(tmp_path):
    assert tuple(characterized(edited(write_imu(tmp_path), _doubled), sensor="V-2").parts) == ("gx",)
    found = characterized(edited(write_imu(tmp_path), _rejected), accept_misfit=True)
    assert any("Beware" in line and "U-1.ay" in line for line in heading(found))


def test_a_result_of_another_kind_of_study_is_refused():
    with pytest.raises(DataError, match="no coefficients"):
        characterized(REPORTS / "scenes")
