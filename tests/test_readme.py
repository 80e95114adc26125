"""What README.md and docs/study.md say is what the package does."""

import contextlib
import inspect
import io
import json
import re
import subprocess
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import jsonschema
import numpy as np
import pytest
import update_study

import imubayes as ib
from imubayes.campaign import Sampling
from imubayes.errors import UnitError
from imubayes.reporting.rows import MARKS
from imubayes.rig.bench import KINDS
from imubayes.rig.formats import FORMATS
from imubayes.rig.inputs import Run
from imubayes.rig.recordings import IMU_CHANNELS, RUN_CHANNELS, Procedure
from imubayes.rig.simulate import PROFILES
from imubayes.sensors.catalogue_file import read_catalogue
from imubayes.study.method import run
from imubayes.study.schema import read_study, tables
from imubayes.study.schema.document import SHAPES, study_schema
from imubayes.units import factor, quantity

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
STUDY = (ROOT / "docs" / "study.md").read_text(encoding="utf-8")
SHIPPED = [study for study in sorted((ROOT / "studies").glob("*.toml")) if study.stem != "sampler_speed"]


def tables_of_keys() -> dict[str, str]:
    return dict(update_study.keyed(study_schema()["$defs"]))


def _between(name: str) -> str:
    """Content of a marked block of the README, without its fence."""
    found = re.search(rf"<!-- {name} -->\n```\w*\n(.*?)```\n<!-- /{name} -->", README, re.S)
    assert found, f"README.md has no block {name}"
    return found[1]


def _sections() -> dict[str, list[list[str]]]:
    """Rows of the tables under each heading of docs/study.md, split into cells."""
    found: dict[str, list[list[str]]] = {}
    heading = ""
    for line in STUDY.splitlines():
        if line.startswith("#"):
            heading = line.lstrip("# ").strip("`")
        elif line.startswith("| ") and not re.match(r"\| (key|`.*`) \| value ", line):
            found.setdefault(heading, []).append([cell.strip() for cell in line.strip("|").split(" | ")])
    return found


SECTIONS = _sections()


def _code(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def _names(section: str) -> set[str]:
    return {name for row in SECTIONS[section] for name in _code(row[0])}


# README.md


def _verdicts(table: str) -> dict[str, str]:
    """Last column by first column, of the lines that end with a verdict."""
    words = "|".join(MARKS)
    rows = (re.match(rf"(\w+) .*?[ \W]({words})$", line) for line in table.splitlines())
    return {row[1]: row[2] for row in rows if row}


def test_example_prints_the_verdicts_of_the_readme():
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(_between("example"), {})
    shown = _verdicts(_between("table"))
    assert _verdicts(printed.getvalue()) == shown
    assert tuple(shown) == ib.library("accelerometer").names


def test_quickstart_comes_to_the_verdicts_of_the_readme():
    (sensor,) = json.loads((ROOT / "reports/quickstart/result.json").read_text(encoding="utf-8"))["sensors"]
    came = {term["name"]: term["verdict"] for term in sensor["terms"]}
    assert _verdicts(_between("quickstart")) == {n: v for n, v in came.items() if v != "untested"}


def test_figure_of_the_readme_is_of_the_quickstart():
    figure = (ROOT / "docs" / "quickstart.svg").read_text(encoding="utf-8")
    shown = dict(re.findall(r"(\w+) \d\.\d\d ([a-z ]+)", figure))
    assert {n: v for n, v in shown.items() if v != "untested"} == _verdicts(_between("quickstart"))


@pytest.mark.parametrize(
    ("name", "extra", "command"),
    [("run", "", "imubayes run studies/quickstart.toml"), ("tests", "test", "pytest -n 2")],
)
def test_command_stands_where_ci_takes_it_from(name, extra, command):
    taking = next(
        line for line in (ROOT / ".ci" / "run").read_text().splitlines() if line.startswith("command=")
    )
    script = f'{taking.replace("tests -->", f"{name} -->")}; printf %s "$command"'
    taken = subprocess.run(["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    wanted = f"'.[{extra}]'" if extra else "."
    assert taken.stdout == (f"python3 -m venv .venv && .venv/bin/pip install {wanted} && .venv/bin/{command}")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert not extra or extra in project["optional-dependencies"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    anchors = {_anchor(title) for title in re.findall(r"^#+ (.*)$", text, re.M)}
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith("#"):
            assert link[1:] in anchors, link
        elif "://" not in link and not link.startswith("made/"):  # those are made with the site
            assert (page.parent / link.partition("#")[0]).exists(), link


def _anchor(title: str) -> str:
    return re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-")


# docs/study.md


def test_tables_of_keys_and_schema_are_those_of_the_code():
    for name, text in update_study.made().items():
        assert (ROOT / "docs" / name).read_text(encoding="utf-8") == text, "run docs/update_study.py"


def test_every_table_of_a_study_has_its_section():
    there = SECTIONS.keys() | set(re.findall(r"^#+ `(.*)`$", (ROOT / "docs" / "plan.md").read_text(), re.M))
    assert set(tables_of_keys()) <= there


@pytest.mark.parametrize("profile", PROFILES)
def test_usual_value_of_an_option_reads_back_to_that_of_the_profile(profile):
    parameters = inspect.signature(PROFILES[profile]).parameters
    shape = tables.simulated(profile)
    stated = study_schema()["$defs"][shape.__name__]["properties"]
    for key, one in stated.items():
        if "default" in one:
            values = {k: v["examples"][0] for k, v in stated.items()} | {key: one["default"]}
            assert getattr(shape(**values), key) == pytest.approx(parameters[key].default, rel=1e-14)


@pytest.mark.parametrize("study", SHIPPED, ids=lambda study: study.stem)
def test_shipped_study_names_the_schema_and_keeps_to_it(study):
    text = study.read_text(encoding="utf-8")
    named = text.partition("\n")[0].removeprefix("#:schema ")
    schema = json.loads((study.parent / named).read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema, format_checker=QUANTITIES).validate(tomllib.loads(text))


def _quantity_of(like: str) -> Callable[[Any], bool]:
    """Check of a text with a unit; one whose unit depends on the sensor has to be a quantity of some kind."""

    unit = None if like.startswith(("output", "like", "of", "channel")) else like

    def check(text: Any) -> bool:
        return not isinstance(text, str) or quantity(text, unit or text.partition(" ")[2]) is not None

    return check


SCHEMA = study_schema()
QUANTITIES = jsonschema.FormatChecker(())
for form in set(re.findall(r"quantity \(.*?\)(?=')", str(SCHEMA))):
    QUANTITIES.checks(form, raises=UnitError)(_quantity_of(form[len("quantity (") : -1]))


@pytest.mark.parametrize("name", SCHEMA["$defs"])
def test_documented_examples_of_a_tables_keys_are_what_these_may_be(name):
    keys = SCHEMA["$defs"][name]["properties"]
    examples = {key: one["examples"][0] for key, one in keys.items() if "examples" in one}
    schema = {"$defs": SCHEMA["$defs"], "$ref": f"#/$defs/{name}"}
    jsonschema.Draft202012Validator(schema, format_checker=QUANTITIES).validate(examples)
    SHAPES[name](**examples)


def test_a_quantity_of_something_else_is_no_example():
    wrong = {"$ref": "#/$defs/SamplingTable", "$defs": SCHEMA["$defs"]}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(wrong, format_checker=QUANTITIES).validate({"time_limit": "3 m"})


def test_documented_errors_of_the_bench_have_the_catalogues_sizes():
    rows = {_code(row[0])[0]: _code(row[2]) for row in SECTIONS["[sensor.reference]"]}
    assert list(rows) == list(KINDS)
    for name, default in rows.items():
        taken = [quantity(text.strip('"'), KINDS[name].unit) for text in default]
        assert taken == pytest.approx([KINDS[name].default] if KINDS[name].default else [], rel=1e-14)
    for row in SECTIONS["[sensor.reference]"]:
        ((name, example),) = tomllib.loads(_code(row[-1])[0]).items()
        assert example is True or quantity(example, KINDS[name].unit) > 0.0


def test_documented_errors_after_compensation_are_those_of_the_reports():
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)`:[^|]*\|(.*)\|$", page, re.MULTILINE)
    assert [name for name, _ in rows] == ["imu_tk_xsens", "imucal_ferraris"]
    for name, cells in rows:
        said = [float(value) for value in re.findall(r"([\d.]+) (?:mg|deg)", cells)]
        (case,) = json.loads((ROOT / f"reports/{name}/result.json").read_text(encoding="utf-8"))["cases"]
        came = []
        for one in case["recovered"]:
            unit = quantity("1 mg", "m/s^2") if one["what"] == "gravity" else quantity("1 deg", "rad")
            sizes = "before", "after", "fresh" if one["saturated"] else "fitted"
            came += [one["rms"][size] / unit for size in sizes]
        assert said == pytest.approx(came, rel=0.05)  # two digits


def test_documented_own_classes_are_a_catalogue(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(STUDY.partition("## Own classes")[2].partition("```toml")[2].partition("```")[0])
    assert [entry.id for entry in read_catalogue(own)] == ["screened"]


def test_documented_procedures_channels_formats_units_and_verdicts_are_those_that_there_are():
    procedures = next(row[3] for row in SECTIONS["[[sensor.run]]"] if row[0] == "`procedure`")
    assert set(_code(procedures)) == set(get_args(Procedure))
    files = {name for row in SECTIONS["Files and columns"] for name in _code(row[0])}
    assert files == {*FORMATS, *RUN_CHANNELS, *IMU_CHANNELS}
    assert _names("Verdicts") == set(MARKS)
    units = [unit for row in SECTIONS["Units"] for unit in _code(row[1])]
    assert all(factor(unit, like=unit) > 0.0 for unit in units)


def _block(language: str) -> str:
    found = re.search(rf"## A complete study of own data.*?```{language}\n(.*?)```", STUDY, re.S)
    assert found
    return found[1]


TRUTH = {"b0": 0.1, "b1": 3e-3, "b2": 2e-5, "m_j": 5e-3, "m_k": -4e-3, "c_ij": 3e-5}
"""SI; each at least 100 sd of the test below from zero, and the other terms zero."""


@pytest.fixture(scope="module")
def own_result(tmp_path_factory):
    """Result of the documented study on files with the documented headers."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "acc12.toml").write_text(_block("toml"), encoding="utf-8")
    study = read_study(folder / "acc12.toml")
    plans = [
        ib.static(300.0, 5.0),
        ib.tumble(angles=12, dwell=5.0, rate=5.0, settle=2.0),
        ib.centrifuge([1, 5, 20], dwell=5.0, rate=5.0, settle=2.0),
    ]
    runs = ib.simulate(ib.sensor("mems_industrial", kind="accelerometer"), plans, seed=4, truth=TRUTH)
    for spec, header, made in zip(study.sensors[0].runs, _block("csv").splitlines(), runs, strict=True):
        _record(made, header, str(spec.file))
    return run(replace(study, compare=False, sampling=Sampling(method="exact")))


def _record(made: Run, header: str, file: str) -> None:
    """Write a run under a header of the documentation: SI values in the units it names."""
    columns = {"t": made.inputs.t, "output": made.output, **made.inputs.channels}
    columns |= {"time": columns["t"] / 1e-3, "adc": np.rint(columns["output"] / (0.5e-3 * G)) + 32768}
    table = [_as_headed(name, columns) for name in header.split(",")]
    np.savetxt(file, np.column_stack(table), delimiter=",", header=header, comments="", fmt="%.9g")


G = factor("g", like="m/s^2")


def _as_headed(name: str, columns: dict[str, np.ndarray]) -> np.ndarray:
    channel, _, unit = name.partition(" ")
    unit = unit.strip("[]")
    values = columns.get(channel, np.zeros_like(columns["t"]))
    return values / factor(unit, like=unit) if unit else values


def test_study_of_own_data_finds_what_the_sensor_does(own_result):
    (sensor,) = own_result.sensors
    terms = {term.name: term for term in sensor.selection.terms}
    assert {name for name, term in terms.items() if term.verdict == "needed"} == set(TRUTH)
    for name, value in TRUTH.items():
        assert terms[name].mean == pytest.approx(value, abs=4.0 * terms[name].sd)


@pytest.mark.parametrize("table", update_study.RESULTS)
def test_every_part_of_a_result_is_documented(table):
    assert STUDY.count(f"| `{table}` | value | meaning |\n") == 1
