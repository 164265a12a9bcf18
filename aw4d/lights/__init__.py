"""Light sources: the ego vehicle's, the street's and other vehicles' lamps, and lights given by the user."""
