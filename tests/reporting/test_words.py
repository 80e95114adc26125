from __future__ import annotations

from dataclasses import replace

import pytest

from imubayes.inference.observability import Confounded
from imubayes.reporting.words import answer, confounded_sentences
from imubayes.sensors.terms import library


def test_answer_does_not_speak_of_a_group_whose_terms_are_all_settled(make_sensor) -> None:
    sensor = make_sensor(lib=library("gyroscope"))
    seen = sensor.selection.observability
    group = Confounded(("b0", "b1"), (1.0, 1.0), 0.2, False, "", "a rate table")
    settled = replace(
        sensor, selection=replace(sensor.selection, observability=replace(seen, groups=(group,)))
    )
    assert "rate table" not in " ".join(answer(settled))


@pytest.mark.parametrize(
    ("exact", "words"), [(True, "appear only in one combination"), (False, "above the noise")]
)
def test_exact_and_nearly_confounded_terms_are_said_apart(exact: bool, words: str) -> None:
    assert words in confounded_sentences([Confounded(("b0", "b2"), (1.0, -1.0), 1.0, exact, "", "")], ())[0]


def test_sensor_without_class_says_so(make_sensor) -> None:
    assert "no class given" in answer(replace(make_sensor(), class_id=""))[0]


def test_groups_of_one_cause_share_a_sentence_and_of_two_causes_do_not() -> None:
    groups = [Confounded((a, b), (1.0, -1.0), 1.0, True, why, "a centrifuge") for a, b, why in CAUSES]
    first, second = confounded_sentences(groups, (), numbered=True)
    assert first.startswith("[1] b0 and b2; [3] c_jj and c_kk each appear only in one combination: x.")
    assert first.count("What would tell: a centrifuge.") == 1
    assert second.startswith("[2] b1 and b3 appear")


CAUSES = (("b0", "b2", "x"), ("b1", "b3", "y"), ("c_jj", "c_kk", "x"))


def test_answer_on_a_triad_names_its_own_terms_by_their_plain_names(make_sensor) -> None:
    sensor = make_sensor("IMU.ay")
    selection, seen = sensor.selection, sensor.selection.observability
    columns = tuple(f"ay.{name}" for name in seen.names)
    groups = (
        Confounded(("ay.c_jj", "ax.b2"), (1.0, -1.0), 1.0, True, "|f| = g", "known directions"),
        Confounded(("ax.c_jj", "az.b2"), (1.0, -1.0), 1.0, True, "|f| = g", "known directions"),
    )
    triad = replace(selection, columns=columns, observability=replace(seen, names=columns, groups=groups))
    text = " ".join(answer(replace(sensor, selection=triad)))
    assert (
        "c_jj (Kpp) and ax.b2 appear" in text
        and "ay." not in text.replace("IMU.ay", "")
        and "az." not in text
    )


def test_answer_with_many_causes_says_only_what_would_tell(make_sensor) -> None:
    sensor = make_sensor()
    seen = sensor.selection.observability
    causes = ("a centrifuge", "a rate table", "a chamber", "a centrifuge")
    groups = tuple(
        Confounded(("c_jj", name), (1.0, -1.0), 1.0, True, f"cause {name}", what)
        for name, what in zip(("b0", "b2", "m_j", "c_kk"), causes, strict=True)
    )
    selection = replace(sensor.selection, observability=replace(seen, groups=groups))
    text = " ".join(answer(replace(sensor, selection=selection)))
    told = "(c_jj and c_kk). What would tell: a centrifuge; a rate table; a chamber."
    assert told in text and "cause b0" not in text
