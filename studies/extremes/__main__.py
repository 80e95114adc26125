"""How many digits are right at the extremes? About three minutes; it needs mpmath, of the extra `test`."""

from studies.command import main
from studies.extremes.measure import SMALL, ExtremesStudy, measure
from studies.extremes.page import extremes_page, extremes_record

if __name__ == "__main__":
    main(ExtremesStudy(), SMALL, measure, extremes_page, extremes_record)
