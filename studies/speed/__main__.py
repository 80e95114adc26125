"""How fast is it, beside what people would use instead? About eight minutes on two cores."""

from studies.command import main
from studies.speed.contests import SMALL, SpeedStudy
from studies.speed.measure import measure
from studies.speed.page import speed_page, speed_record

if __name__ == "__main__":
    main(SpeedStudy(), SMALL, measure, speed_page, speed_record)
