"""The method, from a study's runs to its verdicts."""

from imubayes.study.method import check as check
from imubayes.study.method import run as run
