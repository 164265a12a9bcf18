"""Models that metrics need: loaded from files that the user has, never fetched."""
