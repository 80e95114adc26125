from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from page_reading import printed

from imubayes.campaign.study import SensorCheck
from imubayes.reporting import figures
from imubayes.reporting.document import report_html
from imubayes.reporting.tables import terminal_check, terminal_summary
from imubayes.sensors.terms import library


def test_value_columns_line_up_at_their_sd(result) -> None:
    lines = [
        line
        for line in printed(terminal_summary(result)).splitlines()
        if "+-" in line and "noise" not in line
    ]
    assert len({line.index("+-") for line in lines[1:]}) == 1 and len(lines) == 7


def test_what_is_one_is_in_the_singular(make_sensor, make_study) -> None:
    lib = replace(library("accelerometer", powers=1), terms=library("accelerometer", powers=1).terms[:1])
    one = make_sensor(lib=lib, runs=("tumble",))
    told = printed(terminal_summary(make_study(one))) + report_html(make_study(one))
    told += figures.model_size(one, "k").title + figures.inclusion(one, "k").title
    assert "1 run" in told and "1 term" in told
    assert not re.findall(r"(?<![\d.,^])1 (?:terms|runs|models|samples|blocks|digits|units)\b", told)


def test_check_says_for_every_term_whether_it_is_excited_and_names_each_group(make_sensor) -> None:
    lib = library("accelerometer", powers=3, asymmetry=2)
    text = printed(terminal_check(SensorCheck("ACC-07", lib, make_sensor().selection.observability)))
    lines = {line.split()[0]: line.split() for line in reversed(text.splitlines()) if line.split()}
    assert lines["b0"][2] == "yes" and lines["S_ij"][2] == "no" and lines["c_jj"][-1] == "c_kk"
    assert "third axis" in text and "No run excites b1p" in text
    assert max(len(line) for line in text.splitlines()) <= 80


@pytest.mark.parametrize(("vif", "shown"), [(np.inf, "-"), (np.nan, "-"), (12.34, "12.3"), (2e6, "2e6")])
def test_variance_inflation_of_any_size_is_printed(make_sensor, vif: float, shown: str) -> None:
    lib = library("accelerometer", powers=3, asymmetry=2)
    observability = replace(make_sensor().selection.observability, vif=np.full(len(lib.terms), vif))
    line = next(
        line
        for line in printed(terminal_check(SensorCheck("A", lib, observability))).splitlines()
        if line.startswith("b0 ")
    )
    assert line.split()[-1] == shown


def test_check_of_a_triad_component_reads_its_own_columns(make_sensor) -> None:
    lib = library("accelerometer", powers=3, asymmetry=2)
    alone = make_sensor().selection.observability
    names = tuple(f"{component}.{name}" for component in ("ax", "ay") for name in lib.names)
    group = replace(alone.groups[0], terms=("ay.c_jj", "ax.b2"))
    both = replace(
        alone,
        names=names,
        tested=np.concatenate([~alone.tested, alone.tested]),
        ratio=np.tile(alone.ratio, 2),
        alone=np.tile(alone.alone, 2),
        vif=np.tile(alone.vif, 2),
        groups=(group,),
    )
    text = printed(terminal_check(SensorCheck("IMU.ay", lib, both)))
    lines = {line.split()[0]: line.split() for line in reversed(text.splitlines()) if line.split()}
    assert lines["b0"][2] == "yes" and lines["S_ij"][2] == "no" and lines["c_jj"][-1] == "ax.b2"
    assert "c_jj and ax.b2 appear" in text and "ay." not in text.replace("IMU.ay", "")


def test_summary_says_the_method_the_diagnostics_and_that_the_chains_have_not_converged(
    make_sampled, make_study
) -> None:
    text = printed(terminal_summary(make_study(make_sampled(converged=False))))
    words = " ".join(text.split())
    assert "collapsed, ESS 31, R-hat 1.830" in words and "Posterior: collapsed chains, because" in words
    assert (
        "the chains have not converged (b2 has R-hat 1.83)" in words and "2 dwells are not trusted" in words
    )
    assert max(len(line) for line in text.splitlines()) <= 80
    good = printed(terminal_summary(make_study(make_sampled())))
    assert "not converged" not in good


def test_check_says_errors_of_the_test_bench_in_words(make_sampled) -> None:
    lib = library("accelerometer", powers=3, asymmetry=2)
    sensor = make_sampled()
    seen = sensor.selection.observability
    names = (*seen.names, "gravity")
    group = replace(seen.groups[0], terms=("b1", "gravity"))
    wide = replace(
        seen,
        names=names,
        tested=np.append(seen.tested, True),
        ratio=np.append(seen.ratio, 1.0),
        alone=np.append(seen.alone, 0.1),
        vif=np.append(seen.vif, 1.0),
        groups=(group,),
    )
    extras = tuple(entry.extra for entry in sensor.extras)
    text = " ".join(printed(terminal_check(SensorCheck("ACC-07", lib, wide, extras))).split())
    assert "b1 and the error of local gravity appear only in one combination" in text


def test_summary_ends_with_what_changes_between_sessions(make_study, make_sessions) -> None:
    study = replace(make_study(), sessions=(make_sessions("b0"),))
    text = " ".join(printed(terminal_summary(study), encoding="ascii").split())
    assert text.index("between sessions 1 of 1 parameter changes") > text.index("to the noise floor")
    assert "b0 (sd 55 ug)" in text


def test_term_of_many_groups_names_three_of_them(make_sensor, make_study) -> None:
    sensor = make_sensor()
    seen = sensor.selection.observability
    groups = tuple(
        replace(seen.groups[0], terms=("c_jj", name)) for name in ("b0", "b2", "m_j", "m_k", "c_kk")
    )
    selection = replace(sensor.selection, observability=replace(seen, groups=groups))
    text = printed(terminal_summary(make_study(replace(sensor, selection=selection))))
    assert "inseparable [1,2,3,+2]" in text and "inseparable [5]" in text
