"""Broken studies and files through the real entry point: exit 2, one sentence with the place, no output."""

import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

STUDY = """
[study]
title = "broken"
seed = 1

[[sensor]]
id = "A"
kind = "accelerometer"
class = "mems_tactical"

[[sensor.run]]
name = "tumble"
procedure = "tumble"
file = "run.csv"
"""

HEADER = "t [s],output [m/s^2],f_i [g],f_j [g]"
SIMULATED = """simulate = { angles = 4, planes = 1, dwell = "1 s", rate = "10 Hz" }"""


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


def _directory_as_file(folder: Path) -> None:
    (folder / "study.toml").write_text(STUDY)
    (folder / "run.csv").mkdir()


def _directory_as_study(folder: Path) -> None:
    (folder / "study.toml").mkdir()


def _pickle_in_archive(folder: Path) -> None:
    (folder / "study.toml").write_text(STUDY.replace("run.csv", "run.npz"))
    np.savez(folder / "run.npz", t=np.array([{"a": 1}, None], dtype=object))


def _pickle_as_archive(folder: Path) -> None:
    (folder / "study.toml").write_text(STUDY.replace("run.csv", "run.npz"))
    (folder / "run.npz").write_bytes(pickle.dumps([1.0, 2.0]))


def _array_of_unequal_length(folder: Path) -> None:
    columns = '[sensor.run.columns]\nt = { unit = "s" }\noutput = { unit = "g" }\n'
    (folder / "study.toml").write_text(STUDY.replace("run.csv", "run.npz") + columns)
    np.savez(folder / "run.npz", t=np.arange(10.0), output=np.arange(9.0))


RUN = 'name = "tumble"\nprocedure = "tumble"\nfile = "run.csv"\n'
TWIN = STUDY[STUDY.index("[[sensor]]") :]
LIBRARY = 'class = "mems_tactical"\n[sensor.library]\n'
CLASS = 'class = "mems_tactical"\n'


def _twins(*changes: tuple[str, str]) -> str:
    """Two sessions of one unit; `changes` are made in the second."""
    sessions = [TWIN.replace(CLASS, 'unit = "U"\nsession = "1"\n').replace('"A"', f'"{id}"') for id in "AB"]
    for old, new in changes:
        assert old in sessions[1]
        sessions[1] = sessions[1].replace(old, new)
    return "".join(sessions)


def _appendix(
    content: str | bytes | None, keys: str = 'title = "T"\nfile = "t.csv"'
) -> Callable[[Path], None]:
    """Write the study with a table from elsewhere, beside a good file."""

    def write(folder: Path) -> None:
        _study("[study]", f"[[appendix]]\n{keys}\n\n[study]")(folder)
        if content is not None:
            (folder / "t.csv").write_bytes(content.encode() if isinstance(content, str) else content)

    return write


CASES: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    # the study
    "unknown key": (_study("seed", "sed"), ("study.toml: study.sed", "did you mean 'seed'")),
    "unknown table": (_study("[study]", "[flight]\n[study]"), ("study.toml: flight", "expected one of")),
    "unknown key of a run": (_study("file =", "flie ="), ("sensor[0].run[0].flie", "did you mean 'file'")),
    "syntax": (_study('"A"', '"A'), ("study.toml, line 7", "is not TOML")),
    "no sensor": (_study(STUDY[STUDY.index("[[sensor]]") :], ""), ("study.toml: sensor", "[[sensor]]")),
    "no runs": (_study("[[sensor.run]]\n" + RUN, ""), ("sensor[0].run", "[[sensor.run]]")),
    "run is no list": (_study("[[sensor.run]]", "[sensor.run]"), ("sensor[0].run", "list")),
    "missing name": (_study('name = "tumble"', ""), ("sensor[0].run[0].name", "missing")),
    "wrong type": (_study("seed = 1", 'seed = "one"'), ("study.seed", "'one'")),
    "unknown kind": (_study('"accelerometer"', '"magnetometer"'), ("sensor[0].kind", "'magnetometer'")),
    "imu": (
        _study('"accelerometer"', '"imu"'),
        ("run.csv: column 'f_i [g]'", "expected the inputs along the axes of the case, f_x f_y f_z"),
    ),
    "unknown class": (_study("mems_tactical", "mems_tactial"), ("sensor[0].class", "mems_tactical")),
    "class of the other kind": (_study("mems_tactical", "mech_dtg"), ("sensor[0].class", "gyroscope")),
    "unknown procedure": (
        _study('procedure = "tumble"', 'procedure = "tumbling"'),
        ("run[0].procedure", "'tumbling'"),
    ),
    "duplicate sensors": (_study("\n[[sensor]]", TWIN + "\n[[sensor]]"), ("sensor[1].id", "'A'")),
    "duplicate runs": (_study(RUN, RUN + "[[sensor.run]]\n" + RUN), ("sensor[0].run[1].name", "'tumble'")),
    "negative powers": (_study(CLASS, LIBRARY + "powers = -3\n"), ("sensor[0].library", "powers = -3")),
    "unknown set": (_study(CLASS, LIBRARY + 'set = "full"\n'), ("sensor[0].library.set", "'full'")),
    "heated term": (
        _study(CLASS, LIBRARY + 'temperature = 1\ntemperature_of = ["K0"]\n'),
        ("library", "'K0'"),
    ),
    "noise like an unknown run": (_study(RUN, RUN + 'noise = { run = "log" }\n'), ("run[0].noise", "'log'")),
    "noise like itself": (_study(RUN, RUN + 'noise = { run = "tumble" }\n'), ("run[0].noise", "'tumble'")),
    "noise without unit": (_study(RUN, RUN + "noise = { N = 60.0 }\n"), ("run[0].noise.N", "60.0")),
    "noise of wrong unit": (_study(RUN, RUN + 'noise = { N = "60 ug" }\n'), ("run[0].noise.N", "'ug'")),
    "noise below zero": (
        _study(RUN, RUN + 'noise = { N = "-1 ug/sqrt(Hz)" }\n'),
        ("run[0].noise", "above zero"),
    ),
    "unknown unit": (
        _study(RUN, RUN + 'columns = { output = { unit = "furlong" } }\n'),
        ("run[0].columns.output.unit", "'furlong'"),
    ),
    "unit of another kind": (
        _study(RUN, RUN + 'columns = { f_i = { unit = "deg/h" } }\n'),
        ("run[0].columns.f_i.unit", "'deg/h'"),
    ),
    "unknown channel": (_study(RUN, RUN + 'columns = { fi = "f_i" }\n'), ("run[0].columns.fi", "'f_i'")),
    "scale without unit": (
        _study(RUN, RUN + 'columns = { output = { scale = "2 m/s^2/count" } }\n'),
        ("run[0].columns.output", 'unit = "count"'),
    ),
    "wrap without unit": (
        _study(RUN, RUN + 'columns = { t = { wraps = "60 s" } }\n'),
        ("run[0].columns.t", 'unit = "count"'),
    ),
    "wrap of wrong unit": (
        _study(RUN, RUN + 'columns = { t = { unit = "ms", wraps = "60 m" } }\n'),
        ("run[0].columns.t.wraps", "'m'"),
    ),
    "wrap as a number": (
        _study(RUN, RUN + 'columns = { t = { unit = "ms", wraps = 60 } }\n'),
        ("run[0].columns.t.wraps", "60"),
    ),
    "wrap of zero": (
        _study(RUN, RUN + 'columns = { t = { unit = "ms", wraps = "0 ms" } }\n'),
        ("run[0].columns.t.wraps", "more than zero"),
    ),
    "wrap beyond what counts exactly": (
        _study(RUN, RUN + 'columns = { t = { unit = "ns", wraps = "1e10 s" } }\n'),
        ("run[0].columns.t.wraps", "2^53", "'1e10 s'"),
    ),
    "wrap of an output": (
        _study(RUN, RUN + 'columns = { output = { unit = "g", wraps = "9 g" } }\n'),
        ("run[0].columns.output.wraps", "only the clock"),
    ),
    "wrap shorter than the clock": (
        _study(RUN, RUN + 'columns = { t = { unit = "s", wraps = "10 s" } }\n'),
        ("run.csv", "'t [s]'", "from 0 to 19.5", "at 10"),
    ),
    "file and simulate": (_study(RUN, RUN + SIMULATED), ("sensor[0].run[0]", "both")),
    "neither file nor simulate": (_study('file = "run.csv"', ""), ("sensor[0].run[0]", "neither")),
    "zero-length dwell": (
        _study('file = "run.csv"', SIMULATED.replace('"1 s"', '"0 s"')),
        ("run[0].simulate.dwell", "more than zero", "'0 s'"),
    ),
    "endless dwell": (
        _study('file = "run.csv"', SIMULATED.replace('"1 s"', '"1e999 s"')),
        ("run[0].simulate.dwell", "finite", "'1e999 s'"),
    ),
    "scale of zero": (
        _study(RUN, RUN + 'columns = { output = { unit = "count", scale = "0 m/s^2/count" } }\n'),
        ("run[0].columns.output.scale", "not zero"),
    ),
    "unknown option": (
        _study('file = "run.csv"', SIMULATED.replace("dwell", "dwel")),
        ("run[0].simulate.dwel", "'dwell'"),
    ),
    "too many planes": (
        _study('file = "run.csv"', SIMULATED.replace("planes = 1", "planes = 7")),
        ("'tumble'", "7"),
    ),
    "simulated without class": (
        _study(
            CLASS + '\n[[sensor.run]]\nname = "tumble"\nprocedure = "tumble"\nfile = "run.csv"',
            f'[[sensor.run]]\nname = "tumble"\nprocedure = "tumble"\n{SIMULATED}',
        ),
        ("run[0].simulate", "sensor[0].class"),
    ),
    "truth of no term": (
        _study(CLASS, CLASS + 'truth = { K2 = "3 ug/g^2" }\n'),
        ("sensor[0].truth.K2", "b0"),
    ),
    "truth of wrong unit": (
        _study(CLASS, CLASS + 'truth = { b2 = "3 ug" }\n'),
        ("sensor[0].truth.b2", "'ug'"),
    ),
    "prior of no term": (_study(CLASS, CLASS + 'prior = { b9 = "1 ug" }\n'), ("sensor[0].prior.b9", "b0")),
    "prior of zero": (
        _study(CLASS, CLASS + 'prior = { b0 = "0 ug" }\n'),
        ("sensor[0].prior.b0", "more than zero"),
    ),
    "free tumble without gravity": (
        _study('procedure = "tumble"', 'procedure = "free-tumble"'),
        ("run[0].gravity", "9.81 m/s^2"),
    ),
    "gravity of wrong unit": (
        _study('procedure = "tumble"', 'procedure = "free-tumble"\ngravity = "9.81 m"'),
        ("run[0].gravity", "'m'"),
    ),
    # how the posterior is computed
    "unknown method": (_study("seed = 1", 'method = "gibbs"'), ("study.method", "'collapsed'", "'gibbs'")),
    "unknown key of the sampling": (
        _study("[study]", "[sampling]\nes = 9\n[study]"),
        ("sampling.es", "did you mean 'ess'"),
    ),
    "ess of zero": (_study("[study]", "[sampling]\ness = 0\n[study]"), ("sampling.ess", "greater than 0")),
    "endless ess": (_study("[study]", "[sampling]\ness = inf\n[study]"), ("sampling.ess", "finite")),
    "ess as a text": (_study("[study]", '[sampling]\ness = "many"\n[study]'), ("sampling.ess", "'many'")),
    "time limit without unit": (
        _study("[study]", "[sampling]\ntime_limit = 600\n[study]"),
        ("sampling.time_limit", "quantity with its unit", "600"),
    ),
    "negative time limit": (
        _study("[study]", '[sampling]\ntime_limit = "-1 min"\n[study]'),
        ("sampling.time_limit", "more than zero", "'-1 min'"),
    ),
    "time limit of wrong unit": (
        _study("[study]", '[sampling]\ntime_limit = "10 m"\n[study]'),
        ("sampling.time_limit", "'m'"),
    ),
    # errors of the test bench
    "unknown error of the bench": (
        _study(CLASS, CLASS + "reference = { gravty = true }\n"),
        ("sensor[0].reference.gravty", "did you mean 'gravity'"),
    ),
    "error of the bench as a number": (
        _study(CLASS, CLASS + "reference = { gravity = 1e-6 }\n"),
        ("sensor[0].reference.gravity", "true, false or a quantity", "1e-06"),
    ),
    "error of the bench of zero": (
        _study(CLASS, CLASS + 'reference = { gravity = "0 ug" }\n'),
        ("sensor[0].reference.gravity", "more than zero", "'0 ug'"),
    ),
    "error of the bench of wrong unit": (
        _study(CLASS, CLASS + 'reference = { gravity = "1 arcsec" }\n'),
        ("sensor[0].reference.gravity", "'arcsec'"),
    ),
    "error of the bench that the catalogue does not know": (
        _study(CLASS, CLASS + "reference = { latency = true }\n"),
        ("sensor[0].reference.latency", '"1 ms"', "came true"),
    ),
    "table error of a free tumble": (
        _study(
            CLASS + '\n[[sensor.run]]\nname = "tumble"\nprocedure = "tumble"',
            f"{CLASS}reference = {{ fixture = true }}\n\n[[sensor.run]]\n"
            'name = "free"\nprocedure = "free-tumble"\ngravity = "1 g"',
        ),
        ("sensor[0].reference.fixture", "nothing but gravity"),
    ),
    "robust as a text": (_study(CLASS, CLASS + 'robust = "yes"\n'), ("sensor[0].robust", "'yes'")),
    "robust free tumble": (
        _study(
            CLASS + '\n[[sensor.run]]\nname = "tumble"\nprocedure = "tumble"',
            f'{CLASS}robust = true\n\n[[sensor.run]]\nname = "free"\nprocedure = "free-tumble"\n'
            'gravity = "1 g"',
        ),
        ("sensor[0].robust", "leave it out"),
    ),
    # sessions
    "unit without session": (_study(CLASS, CLASS + 'unit = "U"\n'), ("sensor[0].session", "beside unit")),
    "session without unit": (_study(CLASS, CLASS + 'session = "1"\n'), ("sensor[0].unit", "beside session")),
    "session twice": (_study(TWIN, _twins()), ("sensor[1].session", "'1' of unit 'U'", "sensor[0]")),
    "sessions of two kinds": (
        _study(TWIN, _twins(('"accelerometer"', '"gyroscope"'), ('session = "1"', 'session = "2"'))),
        ("sensor[1].unit", "'U'", "sensor 'A'", "kind or library"),
    ),
    "sessions with two libraries": (
        _study(TWIN, _twins(('session = "1"', 'session = "2"\nlibrary = { powers = 2 }'))),
        ("sensor[1].unit", "'U'", "sensor 'A'", "kind or library"),
    ),
    # tables from elsewhere
    "appendix without file": (_appendix(None, 'title = "T"'), ("appendix[0].file", "missing")),
    "appendix without title": (_appendix("a\n1\n", 'file = "t.csv"'), ("appendix[0].title", "missing")),
    "unknown key of an appendix": (
        _appendix("a\n1\n", 'title = "T"\nfile = "t.csv"\nnotes = ""'),
        ("appendix[0].notes", "did you mean 'note'"),
    ),
    "missing file of an appendix": (_appendix(None), ("appendix[0].file", "t.csv", "no such file")),
    "empty appendix": (_appendix(""), ("appendix[0].file", "t.csv", "headings")),
    "appendix without rows": (_appendix("a,b\n\n"), ("appendix[0].file", "t.csv", "at least one row")),
    "endless appendix": (
        _appendix("a,b\n" + "1,2\n" * 201),
        ("appendix[0].file", "t.csv", "201 rows", "at most 200"),
    ),
    "ragged appendix": (_appendix("a,b\n1,2\n1\n"), ("t.csv, line 3", "expected 2 fields", "came 1")),
    "appendix that is no text": (_appendix(b"\xff\xfe\x00"), ("appendix[0].file", "t.csv", "UTF-8")),
    "appendix of half a quotation": (_appendix('a\n"1\n'), ("appendix[0].file", "t.csv", "CSV")),
    "appendix that is a directory": (
        _appendix(None, 'title = "T"\nfile = "."'),
        ("appendix[0].file", "directory"),
    ),
    "study is a directory": (_directory_as_study, ("study.toml", "directory")),
    "study is not text": (
        lambda folder: (folder / "study.toml").write_bytes(b"\xff\xfe\x00"),
        ("study.toml", "UTF-8"),
    ),
    "no study": (lambda folder: None, ("study.toml", "no such file")),
    # the file of a run
    "missing file": (_study("run.csv", "rum.csv"), ("rum.csv", "no such file")),
    "missing public data": (
        _study('file = "run.csv"', 'file = "$IMUBAYES_DATA/x/y.mat"\nsource = "someone/somewhere (BSD)"'),
        ("$IMUBAYES_DATA/x/y.mat", "someone/somewhere (BSD)"),
    ),
    "directory in place of the file": (_directory_as_file, ("run.csv", "directory")),
    "unknown format": (_file("x", "run.docx"), ("run.docx", "'.docx'")),
    "empty file": (_file(""), ("run.csv", "empty")),
    "header only": (_file(HEADER + "\n"), ("run.csv", "no rows")),
    "blank lines only": (_file("\n\n\n"), ("run.csv", "no rows")),
    "binary garbage": (_file(bytes(range(256)) * 9), ("run.csv", "not a text")),
    "garbage after a good start": (
        _file(_csv(rows=_rows(500)).encode() + b"250,\xff\xfe,1,0\n"),
        ("run.csv", "output [m/s^2]"),
    ),
    "garbage in a text after a good start": (
        _file(_csv(header="t output", rows=["0 1"] * 2000).encode() + b"250 \xff\xfe\n", "run.txt"),
        ("run.txt, line 2002: column 1",),
    ),
    "garbage as Parquet": (_file(b"\x00garbage" * 99, "run.parquet"), ("run.parquet", "Parquet")),
    "garbage as HDF5": (_file(b"\x00garbage" * 99, "run.h5"), ("run.h5", "HDF5")),
    "garbage as MATLAB": (_file(b"MATLAB 5.0 MAT-file" + b"\x07" * 999, "run.mat"), ("run.mat", "MATLAB")),
    "garbage as NumPy": (_file(b"PK\x03\x04" + b"\x07" * 999, "run.npz"), ("run.npz", "NumPy")),
    "pickle in an archive": (_pickle_in_archive, ("run.npz", "pickle")),
    "pickle as an archive": (_pickle_as_archive, ("run.npz", "archive")),
    "arrays of unequal length": (_array_of_unequal_length, ("run.npz", "'output'", "9 rows")),
    "NaN": (_file(_with_row(3, "1.5,nan,1,0")), ("run.csv, line 5", "'output [m/s^2]'", "nan")),
    "empty entry": (_file(_with_row(3, "1.5,,1,0")), ("run.csv, line 5", "'output [m/s^2]'")),
    "infinity": (_file(_with_row(3, "1.5,9.8,Infinity,0")), ("run.csv, line 5", "'f_i [g]'", "inf")),
    "1e300": (_file(_with_row(3, "1.5,1e300,1,0")), ("run.csv, line 5", "1e+300")),
    "text in a number column": (_file(_with_row(3, "1.5,oops,1,0")), ("run.csv, line 5", "'oops'")),
    "ragged row": (_file(_with_row(3, "1.5,9.8")), ("run.csv, line 5", "2 fields")),
    "time goes back": (_file(_with_row(3, "0.25,9.8,1,0")), ("run.csv, line 5", "goes back")),
    "time stands still": (_file(_with_row(3, "1.0,9.8,1,0")), ("run.csv, line 5", "stands still")),
    "one row": (_file(_csv(rows=_rows()[:1])), ("run.csv", "only 1 row")),
    "fewer rows than terms": (_file(_csv(rows=_rows()[:6])), ("6 rows", "10 terms")),
    "constant output": (
        _file(_csv(rows=[f"{k},9.8,{np.cos(k)},0" for k in range(40)])),
        ("run.csv", "'output [m/s^2]'", "9.8 in every row"),
    ),
    "no output column": (
        _file(_csv(header=HEADER.replace("output", "out"))),
        ("run.csv", "'output'", "out [m/s^2]"),
    ),
    "two columns for one channel": (
        _file(_csv(header=HEADER.replace("f_j", "f_i").replace("f_i [g]", "f_i [m/s^2]", 1))),
        ("run.csv", "'f_i [m/s^2]' and 'f_i [g]'"),
    ),
    "column without unit": (
        _file(_csv(header=HEADER.replace("f_i [g]", "f_i"))),
        ("run.csv", "'f_i'", "no unit"),
    ),
    "unit of the file not known": (
        _file(_csv(header=HEADER.replace("f_i [g]", "f_i [furlong]"))),
        ("run.csv", "'f_i [furlong]'"),
    ),
    "column not in the file": (
        _file(_csv(), columns='columns = { output = { column = "adc", unit = "g" } }\n'),
        ("run.csv", "'adc'", "output [m/s^2]"),
    ),
    "number beyond the columns": (
        _file(_csv(), columns='columns = { output = { column = 9, unit = "g" } }\n'),
        ("run.csv", "column 9", "4 columns"),
    ),
}


def _assert_refused(ended, folder: Path, fragments: tuple[str, ...]) -> None:
    assert (ended.code, ended.out) == (2, ""), ended.err
    assert ended.err.startswith("imubayes: ")
    assert ended.err.count("\n") == 1
    assert "Traceback" not in ended.err
    for fragment in fragments:
        assert fragment in ended.err
    assert not (folder / "results").exists()
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("case", CASES)
def test_broken_input_is_refused_in_one_sentence_that_names_the_place(command, case, tmp_path, monkeypatch):
    write, fragments = CASES[case]
    write(tmp_path)
    monkeypatch.setenv("IMUBAYES_DATA", str(tmp_path / "nowhere"))
    ended = command("run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "results"))
    _assert_refused(ended, tmp_path, fragments)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is unreadable for root")
@pytest.mark.parametrize("name", ["study.toml", "run.csv"])
def test_unreadable_file_is_refused(command, name, tmp_path):
    _file(_csv())(tmp_path)
    (tmp_path / name).chmod(0)
    ended = command("run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "results"))
    _assert_refused(ended, tmp_path, (name, "Permission"))


def test_output_folder_that_is_a_file_is_refused(command, tmp_path):
    _file(_csv())(tmp_path)
    (tmp_path / "taken").write_text("mine")
    ended = command("run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "taken"))
    _assert_refused(ended, tmp_path, ("taken", "--out"))
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "fragments"),
    [
        (["--resume"], ("chains", "*.h5", "without --resume")),
        (["--resume", "--method", "exact"], ("--resume", "'exact'")),
        (["--time-limit", "soon"], ("--time-limit", "'soon'")),
        (["--time-limit", "10 m"], ("--time-limit", "'m'")),
        (["--time-limit", "0 s"], ("--time-limit", "'0 s'", "more than zero")),
        (["--ess", "-1"], ("--ess -1", "above zero")),
        (["--ess", "nan"], ("--ess nan", "above zero")),
    ],
    ids=" ".join,
)
def test_option_that_cannot_be_followed_is_refused(command, options, fragments, tmp_path):
    _file(_csv())(tmp_path)
    arguments = [str(tmp_path / "study.toml"), "--out", str(tmp_path / "results")]
    ended = command("run", *arguments, *options)
    _assert_refused(ended, tmp_path, fragments)


def test_simulation_without_a_simulated_run_is_refused(command, tmp_path):
    _file(_csv())(tmp_path)
    ended = command("simulate", str(tmp_path / "study.toml"), "--out", str(tmp_path / "results"))
    _assert_refused(ended, tmp_path, ("study.toml", "[sensor.run.simulate]"))
