"""Are the ranks of simulated truths among posterior draws uniform? About ten minutes on two cores."""

from studies.command import main
from studies.ranks.measure import SMALL, RanksStudy, measure
from studies.ranks.page import terminal_ranks, write_ranks

if __name__ == "__main__":
    main(RanksStudy(), SMALL, measure, terminal_ranks, write_ranks)
