"""Metric scale, ground plane and sky depth of a clip."""
