"""Metrics on files: inputs, pairing, streaming, caches and reports around the arithmetic of `eval`."""
