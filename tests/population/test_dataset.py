from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from fleet_studies import first_part, fleet
from pyarrow import parquet

from imubayes.algebra.factor import Factor, posterior
from imubayes.inference.prior import class_sd
from imubayes.population.dataset import marks_of, read_part, records_of, write_part
from imubayes.population.records import part_found


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
            assert np.array_equal(mine, theirs) if isinstance(mine, np.ndarray) else mine == theirs, field


def test_recorded_units_have_no_truth_in_the_dataset(found, tmp_path):
    study, records = found
    unknown = replace(records[0], truth=np.full(len(study.spec.library.terms), np.nan))
    table = parquet.read_table(_write(tmp_path, study, (unknown,)))
    assert table.column("truth").null_count == table.num_rows
    (back,) = records_of(table)
    assert np.isnan(back.truth).all()


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
    mean, sd = posterior(
        Factor(names, R, own[0]["samples"]), 1e3 * class_sd(study.sensor_class, study.spec.library)
    )
    b1 = names.index("b1")
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
