"""Studies of classes and of fleets, as their files say."""

import json
from dataclasses import replace

import numpy as np
import pytest
from small_studies import FLEET, LOTS, SIMULATED, study_of

from imubayes.population.lots import Against, measure
from imubayes.reporting.blocks import page_html
from imubayes.reporting.lots_page import lots_json, lots_page
from imubayes.rig.simulate import plan_run
from imubayes.sensors.catalogue import classes
from imubayes.sensors.catalogue_file import campaign_of


def test_study_of_classes_has_what_its_file_says(tmp_path):
    study = study_of(tmp_path, LOTS.replace("units = 3", "units = 3\nmethods = 3"))
    assert (study.title, study.seed, study.kind) == ("study", 4, "gyroscope")
    assert (study.units, study.methods) == (3, 3)
    assert [one.id for one in study.classes] == ["mems_tactical", "fog_navigation"]
    assert {one.kind for one in study.classes} == {"gyroscope"}
    assert [[run.name for run in spec.runs] for spec in study.specs] == [["tumble"]] * 2
    assert [(one.name, one.budget.quantity) for one in study.missions] == [("helicopter", "attitude")]
    assert study.text == study.path.read_text(encoding="utf-8")


def test_one_scene_has_two_budgets_by_two_names_in_every_output(tmp_path):
    twice = '[[scene]]\nname = "helicopter, position"\nscene = "helicopter"\nbudget = { position = "1 km" }\n'
    study = study_of(tmp_path, (LOTS + twice).replace("budget =", 'duration = "2 min"\nbudget ='))
    assert [one.name for one in study.missions] == ["helicopter", "helicopter, position"]
    forces = [one.scene.inputs.channels["f_k"] for one in study.missions]
    assert np.array_equal(*forces)
    study = replace(study, specs=study.specs[:1], units=2, processes=1)
    result = measure(study)
    scenes = json.loads(lots_json(result))["scenes"]
    assert [one["name"] for one in scenes] == ["helicopter", "helicopter, position"]
    attitude, position = ([term["share_of_budget"] for term in one["terms"]] for one in scenes)
    assert attitude != position
    html = page_html(lots_page(result))
    for anchor in ("scene-helicopter", "scene-helicopter-position"):
        assert html.count(f'id="{anchor}"') == 1 and f'href="#{anchor}"' in html
    assert "a model in the scene helicopter, position" in html


@pytest.mark.parametrize(
    ("written", "asks"),
    [
        ("", "classes"),
        ('asks = "scenes"', "scenes"),
        ('basic = true\nasks = "triad"', "triad"),
        (
            'asks = { needed_by = ["fog_navigation"], not_by = ["mems_tactical"] }',
            Against(("fog_navigation",), ("mems_tactical",)),
        ),
    ],
)
def test_study_asks_what_its_file_says(tmp_path, written, asks):
    assert study_of(tmp_path, LOTS.replace("units = 3", f"units = 3\n{written}")).asks == asks


def test_each_class_has_the_test_and_the_bench_that_fit_it_where_the_file_says_so(tmp_path):
    """Mutation: with one campaign for all, both classes would dwell alike on one bench."""
    head, _, rest = LOTS.partition("[[lots.run]]")
    own = head.replace("units = 3", 'units = 3\ncampaign = "class"')
    mems, fog = study_of(tmp_path, own + rest[rest.index("[[scene]]") :]).specs
    assert [run.name for run in fog.runs] == ["rate steps", "tumble", "centrifuge", "chamber"]
    assert [run.name for run in mems.runs] == ["rate steps", "tumble", "centrifuge", "oscillation", "chamber"]
    dwells = [
        next(run for run in spec.runs if run.name == "tumble").simulate["dwell"] for spec in (mems, fog)
    ]
    assert dwells == [60.0, 3600.0]
    assert fog.reference["rate_scale"] == pytest.approx(0.5e-6)
    assert mems.reference["rate_scale"] == pytest.approx(5e-6)


@pytest.mark.parametrize("kind", ["accelerometer", "gyroscope"])
def test_every_class_of_the_catalogue_has_a_test_within_its_range(tmp_path, kind):
    """What the rig applies against the typical full scale; hours in the text against the plan's."""
    for entry in classes(kind):
        text = f'[lots]\nkind = "{kind}"\nclasses = ["{entry.id}"]\ncampaign = "class"\n'
        channel, hours = "f_i" if kind == "accelerometer" else "w_i", 0.0
        for run in study_of(tmp_path, text).specs[0].runs:
            inputs = plan_run(run).inputs
            largest = np.abs(inputs.channels.get(channel, np.zeros(1))).max()
            assert largest <= 1.001 * entry.full_scale, (entry.id, run.name)
            hours += (inputs.t[-1] - inputs.t[0] + inputs.interval) / 3600.0
        assert campaign_of(entry)["text"].endswith(f": {hours:.0f} h")


def test_study_of_a_fleet_has_what_its_file_says(tmp_path):
    study = study_of(tmp_path, FLEET)
    assert (study.title, study.seed, study.part, study.processes, study.simulated) == ("study", 4, 8, 2, True)
    assert [study.units[k].name for k in (0, 11)] == ["mems_tactical-01", "mems_tactical-12"]
    assert study.sensor_class.id == "mems_tactical"
    assert study.spec.sensor_class is study.sensor_class
    assert study.spec.reference == {"gravity": 1e-5}
    assert [run.name for run in study.spec.runs] == ["tumble"]
    assert study.text == FLEET


IN_FOLDERS = FLEET.replace(SIMULATED, 'file = "t.csv"')
IN_FILES = FLEET.replace(SIMULATED, "")


@pytest.mark.parametrize(
    ("text", "pattern", "files", "names"),
    [
        (IN_FOLDERS, "lot/*", ("B2/t.csv", "A1/t.csv", "notes.txt", ".git/t.csv"), ["A1", "B2"]),
        (IN_FOLDERS, "{folder}/lot/*/cold", ("A1/cold/t.csv", "A2/cold/t.csv"), ["A1/cold", "A2/cold"]),
        (IN_FILES, "lot/*.csv", ("B2.csv", "A1.csv"), ["A1", "B2"]),
        (IN_FILES, "lot/*", ("A1.csv", "A1.parquet"), ["A1.csv", "A1.parquet"]),
    ],
    ids=["folders in the order of their names", "deep and absolute", "files that hold a run", "of one name"],
)
def test_units_are_what_matches(tmp_path, text, pattern, files, names):
    for name in files:
        file = tmp_path / "lot" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("t [s]\n", encoding="utf-8")
    study = study_of(tmp_path, text.replace("12", f'"{pattern.format(folder=tmp_path)}"', 1))
    assert [(unit.number, unit.name) for unit in study.units] == [*enumerate(names)]
    places = sorted(files) if text is IN_FILES else names
    assert [unit.place for unit in study.units] == [tmp_path / "lot" / place for place in places]
    assert study.spec.runs[0].shown == ("t.csv" if text is IN_FOLDERS else "")
    assert not study.simulated
