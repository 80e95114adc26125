"""How often is the decision wrong, and is any other method better? About 20 minutes on two cores."""

from studies.command import main
from studies.decision_quality.measure import measure
from studies.decision_quality.page import quality_page, quality_record
from studies.decision_quality.trials import OPTIONS, SMALL, QualityStudy

if __name__ == "__main__":
    main(QualityStudy(), SMALL, measure, quality_page, quality_record, OPTIONS)
