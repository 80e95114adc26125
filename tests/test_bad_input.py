"""Broken studies and files through the real entry point: exit 2, one sentence with the place, no output."""

import os
import pickle
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plan_studies import TUMBLE
from small_studies import FLEET, RUN, SENSOR

STUDY = f'[study]\ntitle = "broken"\nseed = 1\n{SENSOR}{RUN}'

HEADER = "t [s],output [m/s^2],f_i [g],f_j [g]"


def _rows(n: int = 40) -> list[str]:
    angle = np.linspace(0.0, 6.0, n)
    return [
        f"{0.5 * k},{9.8 * np.cos(a) + 0.01 * np.sin(7.0 * a):.6f},{np.cos(a):.6f},{np.sin(a):.6f}"
        for k, a in enumerate(angle)
    ]


def _csv(*, header: str = HEADER, rows: list[str] | None = None) -> str:
    return "\n".join([header, *(_rows() if rows is None else rows)]) + "\n"


def _with_row(k: int, row: str) -> str:
    rows = _rows()
    rows[k] = row
    return _csv(rows=rows)


def _study(old: str, new: str) -> Callable[[Path], None]:
    """Write the study with one piece replaced, beside a good file."""
    assert old in STUDY

    def write(folder: Path) -> None:
        (folder / "study.toml").write_text(STUDY.replace(old, new))
        (folder / "run.csv").write_text(_csv())

    return write


def _file(content: str | bytes, name: str = "run.csv", columns: str = "") -> Callable[[Path], None]:
    """Write a file of a run, beside a good study."""

    def write(folder: Path) -> None:
        (folder / "study.toml").write_text(STUDY.replace("run.csv", name) + columns)
        raw = content.encode() if isinstance(content, str) else content
        (folder / name).write_bytes(raw)

    return write


def _archive(columns: str = "", **arrays: np.ndarray) -> Callable[[Path], None]:
    """Write an archive of arrays, beside a good study."""

    def write(folder: Path) -> None:
        (folder / "study.toml").write_text(STUDY.replace("run.csv", "run.npz") + columns)
        np.savez(folder / "run.npz", **arrays)

    return write


UNITS = '[sensor.run.columns]\nt = { unit = "s" }\noutput = { unit = "g" }\n'
COUNTS = UNITS.replace('unit = "s"', 'unit = "count", scale = "1 s/count", wraps = "W count"')
THREE, FOUR = np.arange(3.0), np.arange(4.0)


CASES: dict[str, Callable[[Path], object]] = {
    # the study; `tests/schema/test_messages.py` has every other word of it
    "no sensor": _study(STUDY[STUDY.index("[[sensor]]") :], ""),
    "study is a directory": lambda folder: (folder / "study.toml").mkdir(),
    "study is not text": lambda folder: (folder / "study.toml").write_bytes(b"\xff\xfe\x00"),
    "no study": lambda folder: None,
    # the file of a run
    "missing file": _study("run.csv", "rum.csv"),
    "directory in place of the file": _study("run.csv", "."),
    "unknown format": _file("x", "run.docx"),
    "empty file": _file(""),
    "header only": _file(HEADER + "\n"),
    "blank lines only": _file("\n\n\n"),
    "binary garbage": _file(bytes(range(256)) * 9),
    "garbage after a good start": _file(_csv(rows=_rows(500)).encode() + b"250,\xff\xfe,1,0\n"),
    "garbage in a text after a good start": _file(
        _csv(header="t[s] output[g]", rows=[f"{k} 1" for k in range(2000)]).encode() + b"250 \xff\xfe\n",
        "run.txt",
    ),
    "garbage as Parquet": _file(b"\x00garbage" * 99, "run.parquet"),
    "garbage as HDF5": _file(b"\x00garbage" * 99, "run.h5"),
    "garbage as MATLAB": _file(b"MATLAB 5.0 MAT-file" + b"\x07" * 999, "run.mat"),
    "garbage as NumPy": _file(b"PK\x03\x04" + b"\x07" * 999, "run.npz"),
    "pickle in an archive": _archive(t=np.array([{"a": 1}, None], dtype=object)),
    "pickle as an archive": _file(pickle.dumps([1.0, 2.0]), "run.npz"),
    "arrays of unequal length": _archive(UNITS, t=np.arange(10.0), output=np.arange(9.0)),
    "NaN": _file(_with_row(3, "1.5,nan,1,0")),
    "empty entry": _file(_with_row(3, "1.5,,1,0")),
    "infinity": _file(_with_row(3, "1.5,9.8,Infinity,0")),
    "1e300": _file(_with_row(3, "1.5,1e300,1,0")),
    "text in a number column": _file(_with_row(3, "1.5,oops,1,0")),
    "ragged row": _file(_with_row(3, "1.5,9.8")),
    "time goes back": _file(_with_row(3, "0.25,9.8,1,0")),
    "time stands still": _file(_with_row(3, "1.0,9.8,1,0")),
    "one row": _file(_csv(rows=_rows()[:1])),
    "fewer rows than terms": _file(_csv(rows=_rows()[:6])),
    "constant output": _file(_csv(rows=[f"{k},9.8,{np.cos(k)},0" for k in range(40)])),
    "no output column": _file(_csv(header=HEADER.replace("output", "out"))),
    "two columns for one channel": _file(
        _csv(header=HEADER.replace("f_j", "f_i").replace("f_i [g]", "f_i [m/s^2]", 1))
    ),
    "column without unit": _file(_csv(header=HEADER.replace("f_i [g]", "f_i"))),
    "unit of the file not known": _file(_csv(header=HEADER.replace("f_i [g]", "f_i [furlong]"))),
    "column not in the file": _file(
        _csv(), columns='columns = { output = { column = "adc", unit = "g" } }\n'
    ),
    "number beyond the columns": _file(_csv(), columns='columns = { output = { column = 9, unit = "g" } }\n'),
    **{
        f"address {address}": _archive(
            f"{UNITS[: UNITS.index('output')]}output = {{ column = {address}, unit = 'g' }}\n",
            t=FOUR,
            cube=np.zeros((4, 3, 2)),
        )
        for address in ("'cube'", "'cube[:,3,0]'", "'cube[:,0]'", "'cuba[:,0,0]'", "0")
    },
    "spreadsheet": _file("PK", "means.xlsx"),
    "last line cut off": _file("t[s] output[g]\n0 1\n1 2\n2", "run.txt"),
    "mount of no whole number": _file(_csv(header=HEADER.replace("f_j [g]", "mount"))),
    "mount beyond all mounts": _file(
        _csv(header=HEADER.replace("f_j [g]", "mount"), rows=["0,1,1,1", "1,2,1,1e12", "2,3,1,1"])
    ),
    "clock that overflows": _archive(UNITS, t=np.array([2**32 - 1, 0, 1], dtype=np.uint32), output=THREE),
    "clock beyond its wrap": _archive(COUNTS.replace("W", "60"), t=np.array([0, 70, 3]), output=THREE),
    "clock at its wrap": _archive(COUNTS.replace("W", "60"), t=np.array([0.0, 60.0, 3.0]), output=THREE),
    "wrap between two counts": _archive(
        COUNTS.replace("W", "10.5"), t=np.arange(3, dtype=np.uint32), output=THREE
    ),
    "saturated nearly everywhere": _file(
        _csv(header=HEADER[:-8], rows=[f"{k},{min(k, 150)},{k}" for k in range(2000)])
    ),
    "saturated everywhere": _file(
        _csv(header=HEADER[:-8], rows=[f"{k},{5 * (-1) ** (k // 50)},{k}" for k in range(2000)])
    ),
    "second thermometer alone": _file(_csv(header=HEADER.replace("f_j [g]", "T_2 [degC]"))),
    "means that overlap": _file(_csv(), columns='dwell = "60 s"\n'),
}

LIBRARY = re.compile(r"""(?<=can be read: ).*|(?<=holds )"b'.*'\"""")
"""What another library says."""


def _refused(ended, folder: Path) -> str:
    """What is said of what is refused: one sentence, and nothing is written."""
    assert (ended.code, ended.out) == (2, ""), ended.err
    assert ended.err.startswith("imubayes: ") and ended.err.count("\n") == 1
    assert not (folder / "results").exists()
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    return LIBRARY.sub("*", ended.err.replace(f"{folder}/", ""))


def test_broken_input_is_refused_in_one_sentence_that_names_the_place(command, tmp_path, golden):
    told = []
    for name, write in CASES.items():
        (folder := tmp_path / name).mkdir()
        write(folder)
        ended = command("run", folder / "study.toml", "--out", folder / "results")
        told.append(f"[{name}]\n{_refused(ended, folder)}")
    golden("terminal/broken_input.txt", "\n".join(told))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is unreadable for root")
@pytest.mark.parametrize("name", ["study.toml", "run.csv"])
def test_unreadable_file_is_refused(command, name, tmp_path):
    _file(_csv())(tmp_path)
    (tmp_path / name).chmod(0)
    said = _refused(command("run", tmp_path / "study.toml", "--out", tmp_path / "results"), tmp_path)
    assert name in said and "Permission" in said


OPTIONS = (
    "run --resume",
    "run --resume --method exact",
    "run --time-limit soon",
    'run --time-limit "10 m"',
    'run --time-limit "0 s"',
    "run --ess -1",
    "run --ess nan",
    "run --budget 3",
    'run --budget "-1 s"',
    'run --budget "4 m"',
    "run --accuracy 0",
    'run --budget "1 s" --accuracy 0.1',
    'run --budget "1 s" --method full',
    'run --budget "1 s" --resume',
    "run --out taken",
    "simulate",
    "run fleet.toml --ess 100",
    'run fleet.toml --scheduler ""',
    "run plan.toml",
    "init figures.csv",
    "init row.csv",
    "init apart.csv",
    "init word.csv",
)
"""Commands that cannot be followed, for a study of a recording where no other file is named."""

BESIDE = {
    "taken": "mine",
    "fleet.toml": FLEET,
    "plan.toml": TUMBLE,
    "figures.csv": "figure,published\n1,2\n2,3\n",
    "row.csv": "t,ax\n1,2\n",
    "apart.csv": "t,ax,ay,az\n1,,2,3\n2,3,,4\n",
    "word.csv": "t,ax\n1,2\n2,x\n",
}


def test_option_that_cannot_be_followed_is_refused(command, tmp_path, golden, monkeypatch):
    _file(_csv())(tmp_path)
    for name, text in BESIDE.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    told = []
    for line in OPTIONS:
        name, *options = shlex.split(line)
        file = options.pop(0) if options and options[0] in BESIDE else "study.toml"
        ended = command(name, file, "--out", "results", *options)
        told.append(f"[{line}]\n{_refused(ended, tmp_path)}")
    assert (tmp_path / "taken").read_text() == "mine"
    golden("terminal/broken_options.txt", "\n".join(told))
