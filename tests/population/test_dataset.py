import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from fleet_studies import first_part, fleet, recorded
from pyarrow import parquet

from imubayes.algebra.factor import Factor, posterior
from imubayes.errors import InputError
from imubayes.inference.prior import class_sd
from imubayes.population import part_found
from imubayes.population.dataset import (
    GROWING,
    UNITS,
    fingerprint,
    keep,
    kept_records,
    make_room,
    marks_of,
    part_file,
    publish,
    read_part,
    write_part,
)


@pytest.fixture(scope="module")
def found():
    study = fleet(3)
    return study, part_found(study, first_part(study))


def _write(folder, study, records) -> Path:
    file = folder / "part-00000.parquet"
    write_part(file, records, study.spec.library.names, tuple((one.number, one.name) for one in records))
    return file


def test_records_read_back_to_the_last_bit(found, tmp_path):
    back = read_part(_write(tmp_path, *found))
    for one, other in zip(back, found[1], strict=True):
        for field in fields(one):
            mine, theirs = getattr(one, field.name), getattr(other, field.name)
            same = isinstance(mine, np.ndarray) and np.array_equal(mine, theirs)
            assert same or mine == theirs or (field.name == "rhat" and np.isnan([mine, theirs]).all()), field


def test_a_row_is_a_unit_and_a_term_and_their_factor_gives_the_posterior_again(found, tmp_path):
    study, records = found
    names = study.spec.library.names
    rows = parquet.read_table(_write(tmp_path, *found)).to_pylist()
    assert [(row["unit"], row["term"]) for row in rows] == [
        (one.name, name) for one in records for name in names
    ]
    own = rows[: len(names)]
    R = np.zeros((len(names) + 1, len(names) + 1))
    for j, row in enumerate(own):
        R[j, j:] = row["factor"]
    R[-1, -1] = own[0]["rho"]
    # the response's norm, whitened, is that of the noise and of what the terms explain
    prior = class_sd(study.sensor_class, study.spec.library)
    # an infinite prior of the term itself
    b1 = names.index("b1")
    prior[b1] = np.inf
    mean, sd = posterior(Factor(names, R / own[0]["scale"], own[0]["samples"]), prior)
    assert mean[b1] == pytest.approx(own[b1]["full_mean"], abs=1e-6 * own[b1]["full_sd"])
    assert sd[b1] == pytest.approx(own[b1]["full_sd"], rel=1e-6)


def test_file_that_is_not_whole_or_is_another_program_s_has_no_marks_and_no_records(found, tmp_path):
    file = _write(tmp_path, *found)
    assert [number for number, _ in marks_of(file) or ()] == [0, 1, 2]
    file.write_bytes(file.read_bytes()[:-100])
    assert (marks_of(file), read_part(file)) == (None, ())
    file.unlink()
    assert (marks_of(file), read_part(file)) == (None, ())
    parquet.write_table(pa.table({"t": [0.0]}), file)
    assert marks_of(file) is None


def _prints(study) -> list[str]:
    return [fingerprint(study, unit) for unit in study.units]


def _keep(folder: Path, study, found, *, index: int = 0, changed: bool = True):
    make_room(folder, study)
    return keep(folder, index, found, study.spec.library.names, _prints(study), changed=changed)


def _files(folder: Path) -> list[str]:
    return sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())


@pytest.mark.parametrize("change", ["text", "class", "name"])
def test_record_of_another_study_is_not_taken_for_finished(found, tmp_path, change):
    study, records = found
    _keep(tmp_path, *found)
    assert sorted(kept_records(tmp_path, _prints(study))) == [0, 1, 2]
    other = {
        "text": lambda: replace(study, text=study.text + " "),
        "class": lambda: replace(study, sensor_class=replace(study.sensor_class, full_scale=1.0)),
        "name": lambda: replace(study, units=tuple(replace(unit, name="x") for unit in study.units)),
    }[change]()
    assert kept_records(tmp_path, _prints(other)) == {}
    assert len(records) == 3


def test_file_of_a_unit_that_is_changed_makes_it_another_one_and_leaves_its_neighbour(tmp_path):
    study = recorded(tmp_path, ("A1", "A2"))
    before, file = _prints(study), tmp_path / "units" / "A2" / "tumble.csv"
    os.utime(file, ns=(1, 1))
    touched = _prints(study)
    file.unlink()
    gone = _prints(study)
    assert len({before[1], touched[1], gone[1]}) == 3
    assert before[0] == touched[0] == gone[0]


def test_parts_of_an_earlier_study_leave_the_dataset_and_other_files_stay(found, tmp_path):
    study, records = found
    earlier = {0: _keep(tmp_path, *found), 7: _keep(tmp_path, study, records, index=7)}
    publish(tmp_path, earlier)
    _keep(tmp_path, study, records, index=8)
    for name in ("notes.txt", "part-1.txt"):
        (tmp_path / UNITS / name).write_text("mine")
    publish(tmp_path, {0: _keep(tmp_path, *found)})
    assert _files(tmp_path) == ["units/notes.txt", "units/part-00000.parquet", "units/part-1.txt"]


@pytest.mark.parametrize("name", ["U0.parquet", "part-00000.parquet"])
@pytest.mark.parametrize("within", [UNITS, GROWING])
def test_file_that_no_fleet_wrote_is_refused_and_stays(tmp_path, name, within):
    (tmp_path / within).mkdir()
    file = tmp_path / within / name
    parquet.write_table(pa.table({"t": [0.0]}), file)
    with pytest.raises(InputError, match=rf"{name}: is not whole, or .*choose another --out"):
        make_room(tmp_path, fleet(3))
    assert _files(tmp_path) == [f"{within}/{name}"]


def test_part_under_another_name_is_somebodys_copy_and_is_refused(found, tmp_path):
    publish(tmp_path, {0: _keep(tmp_path, *found)})
    part_file(tmp_path, 0).rename(tmp_path / UNITS / "backup.parquet")
    with pytest.raises(InputError, match=r"backup\.parquet"):
        make_room(tmp_path, found[0])
