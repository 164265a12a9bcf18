"""Light sources: the ego vehicle's headlights and lights given by the user."""
