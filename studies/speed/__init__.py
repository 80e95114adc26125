"""How fast the method is, beside what people would use instead."""
