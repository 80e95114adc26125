"""Every format gives the same columns; what is not columns of numbers is named."""

from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from imubayes.errors import DataError
from imubayes.rig.formats import FileTable, bare, bracketed, read_table

T = np.array([0.0, 0.1, 0.30000000000000004, 1e5])
Y = np.array([9.80665, -1e-12, 3.0, -2.5e7])
NAMES = ("t [s]", "output [m/s^2]")


def _text(separator: str, names: tuple[str, ...] = NAMES, comma: bool = False) -> str:
    lines = [
        separator.join(names),
        *(separator.join((repr(float(t)), repr(float(y)))) for t, y in zip(T, Y, strict=True)),
    ]
    body = "\n".join(lines) + "\n"
    return body.replace(".", ",") if comma else body


def _hdf5(path: Path, group: str = "", attribute: bool = True) -> None:
    with h5py.File(path, "w") as file:
        for name, values, unit in (("t", T, "s"), ("output", Y, "m/s^2")):
            dataset = file.create_dataset(f"{group}{name}", data=values)
            if attribute:
                dataset.attrs["unit"] = unit


def _matlab73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("IMU", data=np.column_stack([T, Y]).T)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(512))


WRITERS = {
    "comma.csv": lambda path: path.write_text(_text(",")),
    "semicolon.csv": lambda path: path.write_text(_text(";")),
    "decimal_comma.csv": lambda path: path.write_text(_text(";", comma=True)),
    "tab.tsv": lambda path: path.write_text(_text("\t")),
    "byte_order_mark.csv": lambda path: path.write_text(_text(","), encoding="utf-8-sig"),
    "windows_lines.csv": lambda path: path.write_bytes(_text(",").replace("\n", "\r\n").encode()),
    "quoted.csv": lambda path: path.write_text(_text(",", tuple(f'"{name}"' for name in NAMES))),
    "commented.csv": lambda path: path.write_text("# made by hand\n" + _text(",")),
    "blanks.txt": lambda path: path.write_text(_text("  ")),
    "separated.txt": lambda path: path.write_text(_text(";")),
    "blanks.dat": lambda path: path.write_text("% bench 3\n\n" + _text("\t\t".replace("\t", "   "))),
    "arrow.parquet": lambda path: pq.write_table(pa.table(dict(zip(NAMES, (T, Y), strict=True))), path),
    "root.h5": _hdf5,
    "group.hdf5": lambda path: _hdf5(path, group="bench/run/"),
    "blanks.log": lambda path: path.write_text(_text(" ")),
    "utf16.csv": lambda path: path.write_text(_text(";", comma=True), encoding="utf-16"),
    "named_in_a_comment.csv": lambda path: path.write_text("# bench 3\n#" + _text(",")),
    "named_in_a_comment.txt": lambda path: path.write_text("# " + _text(" ")),
    "text.mat": lambda path: path.write_text(_text(" ")),
    "binary.mat": lambda path: scipy.io.savemat(path, {"t": T, "output": Y}),
    "struct.mat": lambda path: scipy.io.savemat(path, {"log": {"t": T, "output": Y}}),
    "matrix.mat": lambda path: scipy.io.savemat(path, {"IMU": np.column_stack([T, Y])}),
    "matrix73.mat": _matlab73,
    "arrays.npz": lambda path: np.savez(path, t=T, output=Y),
    "matrix.npy": lambda path: np.save(path, np.column_stack([T, Y])),
    "matrix.npz": lambda path: np.savez(path, IMU=np.column_stack([T, Y])),
    "cube.npz": lambda path: np.savez(path, IMU=np.stack([np.column_stack([T, Y])] * 3, axis=1)),
}
ADDRESSES = {
    "struct.mat": ("log.t", "log.output"),
    "matrix.mat": ("IMU[:,0]", "IMU[:,1]"),
    "matrix73.mat": ("IMU[:,0]", "IMU[:,1]"),
    "matrix.npy": ("matrix[:,0]", "matrix[:,1]"),
    "matrix.npz": ("IMU[:,0]", "IMU[:, 1]"),
    "cube.npz": ("IMU[:,2,0]", "IMU[:,2,1]"),
}


def _column(table: FileTable, wanted: str | int) -> np.ndarray:
    return table.locate(wanted, "channel")[1]


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_every_number_to_its_last_bit(name, tmp_path):
    path = tmp_path / name
    WRITERS[name](path)
    table = read_table(path)
    t, output = ADDRESSES.get(name, ("t", "output"))
    np.testing.assert_array_equal(_column(table, t), T)
    np.testing.assert_array_equal(_column(table, output), Y)


@pytest.mark.parametrize("name", ["comma.csv", "arrow.parquet", "root.h5", "group.hdf5"])
def test_unit_is_part_of_the_columns_name(name, tmp_path):
    WRITERS[name](tmp_path / name)
    table = read_table(tmp_path / name)
    assert bracketed(table.locate("output", "output")[0]) == "m/s^2"
    assert sorted(map(bare, table.columns)) == ["output", "t"]


@pytest.mark.parametrize("suffix", ["csv", "txt", "mat"])
def test_columns_of_a_file_without_header_are_numbered_from_zero(suffix, tmp_path):
    separator = "," if suffix == "csv" else " "
    path = tmp_path / f"log.{suffix}"
    path.write_text(f"0.0{separator}1\n0.5{separator}2\n")
    table = read_table(path)
    assert table.columns == ("0", "1")
    np.testing.assert_array_equal(_column(table, 1), [1.0, 2.0])
    assert table.place(1) == "line 2"


def test_lines_are_counted_as_an_editor_does(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("# bench 3\n\nt [s],output [g]\n\n0,1\n1,2\n\n2,x\n")
    table = read_table(path)
    assert table.place(0) == "line 5"
    with pytest.raises(DataError, match=r"line 8: column 'output \[g\]' holds 'x'"):
        table.locate("output", "output")


def test_text_in_a_column_that_nobody_asks_for_is_no_error(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t [s],date,output [g]\n0,2024-01-01,1\n1,noon,2\n")
    np.testing.assert_array_equal(_column(read_table(path), "output"), [1.0, 2.0])


def test_object_arrays_are_never_unpickled(tmp_path, monkeypatch):
    np.savez(tmp_path / "run.npz", t=np.array([{}], dtype=object))
    monkeypatch.setattr("pickle.load", lambda *_, **__: pytest.fail("a pickle was loaded"))
    with pytest.raises(DataError, match="holds a pickle"):
        read_table(tmp_path / "run.npz")
