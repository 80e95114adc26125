"""How many digits are right at the extremes, held against exact arithmetic."""
