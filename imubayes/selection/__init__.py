"""Which terms are there: the evidence of every submodel, and one verdict per term."""
