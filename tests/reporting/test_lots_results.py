import json

from lots_found import SIZES, lot_result

from imubayes.reporting.lots_page import lots_json


def test_result_has_the_keys_of_ordinary_studies_and_the_lots():
    result = lot_result()
    told = json.loads(lots_json(result))
    assert {"imubayes", "study", "seed", "scenes", "lots"} <= told.keys()
    assert [(one["name"], one["sensor"]) for one in told["scenes"]] == [
        (scene, name) for name in SIZES for scene in ("helicopter", "fixed_wing")
    ]
    assert told["scenes"][0]["model"] == ["g_i", "g_k"]
    first = told["lots"]["classes"][0]
    assert [term["name"] for term in first["terms"]] == told["lots"]["terms"]
    assert first["units"][1]["truth"] == result.classes[0].units[1].truth.tolist()
    assert first["units"][0]["full_sd"] == result.classes[0].units[0].full_sd.tolist()
    assert told["lots"]["check"]["precision"]["value"] == result.check.precision.value


def test_what_is_not_a_number_becomes_null():
    told = json.loads(lots_json(lot_result(basic=False)))
    assert told["scenes"][0]["basic_share_of_budget"] is None
