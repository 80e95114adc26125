"""Are the ranks of simulated truths among posterior draws uniform? About ten minutes on two cores."""

from studies.command import main
from studies.ranks.measure import SMALL, RanksStudy, measure
from studies.ranks.page import ranks_page, ranks_record

if __name__ == "__main__":
    main(RanksStudy(), SMALL, measure, ranks_page, ranks_record)
