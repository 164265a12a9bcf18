"""NumPy references: one module a pass; each defines the result that its kernel is checked against."""
