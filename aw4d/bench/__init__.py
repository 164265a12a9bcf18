"""Speed against error: every pass on every backend, beside the machine's limits and peers of the same arithmetic."""
