import os
from dataclasses import fields, replace

import numpy as np
import pytest
from fleet_studies import first_part, fleet, recorded
from pyarrow import parquet

from imubayes.errors import InputError
from imubayes.factor import Factor, posterior
from imubayes.fleet.dataset import clear, fingerprint, part_file, read_part, records_of, write_part
from imubayes.fleet.plan import parts_of
from imubayes.fleet.units import Broken, part_found
from imubayes.inference.prior import class_sd


@pytest.fixture(scope="module")
def found():
    study = fleet(3)
    part = first_part(study)
    return study, part, replace(part_found(study, part), broken=(Broken(1, "u", 'says "no"'),))


def _write(folder, study, part, found) -> str:
    clear(folder, ())
    mark = fingerprint(study, part)
    write_part(folder, found, study.spec.library.names, mark)
    return mark


def test_records_read_back_to_the_last_bit(found, tmp_path):
    _, part, records = found
    back = read_part(tmp_path, part, _write(tmp_path, *found))
    assert back is not None
    assert back.broken == records.broken
    for one, other in zip(back.records, records.records, strict=True):
        for field in fields(one):
            mine, theirs = getattr(one, field.name), getattr(other, field.name)
            assert np.array_equal(mine, theirs) if isinstance(mine, np.ndarray) else mine == theirs, field


def test_recorded_units_have_no_truth_in_the_dataset(found, tmp_path):
    study, part, records = found
    unknown = replace(records.records[0], truth=np.full(len(study.spec.library.terms), np.nan))
    _write(tmp_path, study, part, replace(records, records=(unknown,)))
    table = parquet.read_table(tmp_path / "units")
    assert table.column("truth").null_count == table.num_rows
    (back,) = records_of(table)
    assert np.isnan(back.truth).all()


def test_a_row_is_a_unit_and_a_term_and_their_factor_gives_the_posterior_again(found, tmp_path):
    study, _, records = found
    _write(tmp_path, *found)
    names = study.spec.library.names
    rows = parquet.read_table(tmp_path / "units").to_pylist()
    assert [(row["unit"], row["term"]) for row in rows] == [
        (one.name, name) for one in records.records for name in names
    ]
    own = rows[: len(names)]
    R = np.zeros((len(names) + 1, len(names) + 1))
    for j, row in enumerate(own):
        R[j, j:] = row["factor"]
    R[-1, -1] = own[0]["rho"]
    # the response's norm, whitened, is that of the noise and of what the terms explain
    mean, sd = posterior(
        Factor(names, R, own[0]["samples"]), 1e3 * class_sd(study.sensor_class, study.spec.library)
    )
    b1 = names.index("b1")
    assert mean[b1] == pytest.approx(own[b1]["full_mean"], abs=1e-6 * own[b1]["full_sd"])
    assert sd[b1] == pytest.approx(own[b1]["full_sd"], rel=1e-6)


@pytest.mark.parametrize("change", ["text", "seed", "class", "units"])
def test_part_of_another_study_is_not_taken_for_finished(found, tmp_path, change):
    study, part, _ = found
    _write(tmp_path, *found)
    other = {
        "text": lambda: (replace(study, text=study.text + " "), part),
        "seed": lambda: (replace(study, text="seed = 6"), part),
        "class": lambda: (replace(study, sensor_class=replace(study.sensor_class, full_scale=1.0)), part),
        "units": lambda: (study, replace(part, units=part.units[:2])),
    }[change]()
    assert read_part(tmp_path, part, fingerprint(*other)) is None


def test_part_that_is_not_whole_is_not_finished(found, tmp_path):
    _, part, _ = found
    mark = _write(tmp_path, *found)
    file = part_file(tmp_path, 0)
    file.write_bytes(file.read_bytes()[:-100])
    assert read_part(tmp_path, part, mark) is None
    file.unlink()
    assert read_part(tmp_path, part, mark) is None


def test_file_that_is_mended_is_another_one(tmp_path):
    study = recorded(tmp_path, ("A1", "A2"))
    (part,) = parts_of(study, None)
    before, file = fingerprint(study, part), tmp_path / "units" / "A2" / "tumble.csv"
    os.utime(file, ns=(1, 1))
    touched = fingerprint(study, part)
    file.unlink()
    assert len({before, touched, fingerprint(study, part)}) == 3


def test_files_of_an_earlier_study_leave_the_dataset(found, tmp_path):
    study, _, records = found
    _write(tmp_path, *found)
    write_part(tmp_path, replace(records, index=7), study.spec.library.names, "old")
    clear(tmp_path, [0])
    assert [file.name for file in (tmp_path / "units").iterdir()] == ["part-00000.parquet"]


def test_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file: cannot be written .*choose another --out"):
        clear(tmp_path / "file", ())
